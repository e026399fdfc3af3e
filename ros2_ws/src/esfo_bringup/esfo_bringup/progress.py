"""Progress bars, shown on a terminal only."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NoReturn, TypeVar

from tqdm import tqdm

from esfo_core.recordings import Recording

T = TypeVar("T")

_FORMAT = "{l_bar}{bar}| {elapsed} left {remaining}"


def share_bar(name: str) -> tqdm[NoReturn]:
    """Return a bar from 0 to 1 that appears after a second; move it with `advance`."""
    return tqdm(total=1.0, desc=name, bar_format=_FORMAT, disable=None, delay=1.0, leave=False)


def advance(bar: tqdm[NoReturn], share: float) -> None:
    """Move the bar to `share` of the whole."""
    bar.update(share - bar.n)


def follow(recording: Recording, chunks: Iterable[T], name: str) -> Iterator[T]:
    """Yield the chunks of a recording and show which share of it has been read."""
    with share_bar(name) as bar:
        for chunk in chunks:
            yield chunk
            advance(bar, recording.progress())


def stage_bar(stages: int) -> tqdm[NoReturn]:
    """Return a bar of whole stages; `next_stage` begins one."""
    return tqdm(total=stages, bar_format="{desc}: {bar}| {elapsed}", disable=None, delay=1.0, leave=False)


def next_stage(bar: tqdm[NoReturn], name: str) -> None:
    """Show the name of the stage that begins."""
    bar.set_description(f"estimating, {name.replace('_', ' ')}")
    bar.update()
