"""Writing of result.mcap; without ROS messages, or on a full disk, the run continues without it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import Queue
from types import TracebackType
from typing import Literal, NamedTuple, Protocol

from esfo_bringup.errors import CommandError
from esfo_bringup.offline.pipeline import RunResult
from esfo_bringup.offline.source import Source
from esfo_bringup.result_bag.stream_health import HealthReport, StreamHealth
from esfo_core.errors import EsfoError
from esfo_core.events import EventArray
from esfo_frontend.frontend import FrontendOutput

Content = Literal["all", "no-events", "none"]
CONTENTS: tuple[Content, ...] = ("all", "no-events", "none")
NAME = "result.mcap"

_MOST_WAITING = 200
"""Chunks that may wait to be written; beyond, the run waits."""


class EventRecorder(Protocol):
    """Writes a bag; `esfo_bringup.result_bag.recorder.Recorder` does, which needs the ROS messages."""

    def add(self, events: EventArray, output: FrontendOutput, health: HealthReport | None) -> None:
        """Write events (N,), which follow the earlier ones, what they settled, and the health of the stream."""

    def finish(self, result: RunResult) -> None:
        """Write the result of the run and complete the bag."""

    def discard(self) -> None:
        """Delete the bag unless it is complete."""


MakeRecorder = Callable[[Path, Source, bool], EventRecorder]
"""Begins the bag of a source at a path, with or without events. Raises ImportError without ROS messages."""


class _Piece(NamedTuple):
    events: EventArray
    output: FrontendOutput
    health: HealthReport | None


def bag_path(folder: Path, source: Source) -> Path:
    """Return the path of the bag in the folder of results. Raises CommandError when it is that of the recording."""
    path = folder / NAME
    if path.resolve() == source.recording.path.resolve():
        raise CommandError(f"{path} is the recording: choose another folder for the results")
    return path


class ResultBag:
    """The bag of one run, at `path`, written by a separate thread during the run.

    After the `with` block the bag exists, or `problem` says in one line why not. An incomplete bag and the bag of an
    earlier run are deleted.
    """

    def __init__(self, folder: Path, source: Source, content: Content, make_recorder: MakeRecorder) -> None:
        """Begin the bag in the folder, which is created. content: what to write. make_recorder: called by the thread.

        Raises CommandError as `bag_path`.
        """
        self.path, self.problem = bag_path(folder, source), ""
        folder.mkdir(parents=True, exist_ok=True)
        self._source, self._content, self._make_recorder = source, content, make_recorder
        self._health = StreamHealth(source.recording)
        self._queue: Queue[_Piece | RunResult | None] = Queue(_MOST_WAITING)
        self._at_end = False
        self._pool = ThreadPoolExecutor(1, "result_bag")
        self._work = self._pool.submit(self._record_all)

    def add(self, events: EventArray, output: FrontendOutput) -> None:
        """Write events (N,), which follow the earlier ones, and what they settled."""
        self._queue.put(_Piece(events, output, self._health.add(events, output)))

    def finish(self, result: RunResult) -> None:
        """Write the result of the run and complete the bag."""
        self._queue.put(result)

    def __enter__(self) -> ResultBag:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._queue.put(None)
        self._pool.shutdown()
        if error is not None:
            return
        self._work.result()
        if self.problem or self._content == "none":
            self.path.unlink(missing_ok=True)

    def _record_all(self) -> None:
        """Write the bag, and empty the queue also after an error: the run must not wait for it."""
        try:
            if self._content != "none":
                self._record()
        finally:
            while not self._at_end:
                self._next()

    def _record(self) -> None:
        recorder: EventRecorder | None = None
        try:
            recorder = self._make_recorder(self.path, self._source, self._content == "all")
            while (piece := self._next()) is not None:
                if isinstance(piece, RunResult):
                    recorder.finish(piece)
                else:
                    recorder.add(piece.events, piece.output, piece.health)
        except ImportError as error:
            self.problem = f"the ROS messages cannot be loaded ({error})"
        except (EsfoError, OSError) as error:
            self.problem = str(error)
        finally:
            if recorder is not None:
                recorder.discard()

    def _next(self) -> _Piece | RunResult | None:
        piece = self._queue.get()
        self._at_end = piece is None
        return piece
