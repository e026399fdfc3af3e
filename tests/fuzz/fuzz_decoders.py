"""Fuzz one decoder, guided by coverage (docs/fuzzing.md): `fuzz_decoders.py ENCODING CORPUS [options]`.

Needs atheris. The kernels run as plain Python, because the fuzzer cannot look into compiled ones.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

os.environ["NUMBA_DISABLE_JIT"] = "1"

import atheris
import numpy as np

with atheris.instrument_imports(include=["esfo_core.codecs"]):
    from decoder_check import check, seeds

    from esfo_core.codecs import ENCODINGS, evt3


def as_plain_python() -> None:
    """Give the kernels what compiled code has and plain Python lacks: events with attributes, sums that do not wrap."""
    for name, module in list(sys.modules.items()):
        if name.startswith("esfo_core"):
            for dtype in ("EVENT_DTYPE", "TRIGGER_DTYPE"):
                if hasattr(module, dtype):
                    setattr(module, dtype, np.dtype((np.record, getattr(module, dtype))))
    evt3._EVENTS_IN_WORD = evt3._EVENTS_IN_WORD.astype(np.int64)


def main() -> None:
    """Write the seeds to the folder of the corpus and fuzz; or try one file."""
    if len(sys.argv) < 3 or sys.argv[1] not in ENCODINGS:
        raise SystemExit(f"usage: fuzz_decoders.py ENCODING CORPUS [options]; encodings: {', '.join(ENCODINGS)}")
    encoding = sys.argv.pop(1)
    corpus = Path(sys.argv[1])
    as_plain_python()
    if not corpus.is_file():  # a file is an earlier failure, to be repeated
        corpus.mkdir(parents=True, exist_ok=True)
        for i, seed in enumerate(seeds(encoding)):
            (corpus / f"seed{i}").write_bytes(seed)
    atheris.Setup(sys.argv, lambda data: check(encoding, data))
    atheris.Fuzz()


if __name__ == "__main__":
    main()
