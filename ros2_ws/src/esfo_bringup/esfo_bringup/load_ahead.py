"""Modules that take long to load, loaded by another thread before they are needed."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from threading import Thread


def load_ahead(names: Sequence[str]) -> None:
    """Begin to import modules, in the order given; `import_module` then waits for one that is not ready yet."""
    Thread(target=_load, args=(names,), daemon=True).start()


def _load(names: Sequence[str]) -> None:
    for name in names:
        with suppress(ImportError):  # the import that needs the module says so
            import_module(name)
