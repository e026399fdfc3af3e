"""Opening of a path as a recording, by the format of its contents."""

from __future__ import annotations

import re
from pathlib import Path

import yaml

from esfo_core.errors import CameraError, RecordingError
from esfo_core.recordings.aedat4 import MAGIC as AEDAT4
from esfo_core.recordings.aedat4 import Aedat4Recording
from esfo_core.recordings.bag import BagRecording
from esfo_core.recordings.byte_stream import COMPRESSED
from esfo_core.recordings.hdf5 import MAGIC as HDF5
from esfo_core.recordings.hdf5 import Hdf5Recording
from esfo_core.recordings.prophesee import PropheseeRecording, has_format
from esfo_core.recordings.reading_options import ReadingOptions
from esfo_core.recordings.recording import Recording
from esfo_core.recordings.text import TextRecording

_BAG_KINDS = {
    b"\x89MCAP0\r\n": (".mcap", "ROS 2 bag (MCAP)"),
    b"SQLite format 3\0": (".db3", "ROS 2 bag (SQLite)"),
    b"#ROSBAG V2.0\n": (".bag", "ROS 1 bag"),
}

_TEXT = frozenset(range(32, 127)) | frozenset("\t\r\nµ".encode())
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_NOTHING_TOLD = ReadingOptions()


def open_recording(path: Path, topic: str | None = None, options: ReadingOptions = _NOTHING_TOLD) -> Recording:
    """Open an event recording of any known format, told by its first bytes.

    path: a ROS 2 bag (folder, `.mcap` or `.db3` file), a ROS 1 bag (`.bag`), a Prophesee RAW (EVT2, EVT2.1, EVT3) or
    DAT file, an AEDAT4 file, an HDF5 file of Prophesee or DSEC, or text, plain or compressed.
    topic: which event topic of a bag or stream of an AEDAT4 file, needed only when it has several.
    options: what the file does not tell.

    Raises RecordingError when there is nothing to read at `path` or it is not of a known format, and CameraError when
    the calibration in a bag is impossible.
    """
    try:
        recording = _open_folder(path, topic, options) if path.is_dir() else _open_file(path, topic, options)
    except (RecordingError, CameraError) as error:
        raise type(error)(f"{path}: {error}") from error
    except OSError as error:
        raise RecordingError(f"{error.filename or path}: {error.strerror}") from error
    recording.wanted_segment = options.segment
    return recording


def _open_file(path: Path, topic: str | None, options: ReadingOptions) -> Recording:
    start = _first_bytes(path)
    for magic, (suffix, kind) in _BAG_KINDS.items():
        if start.startswith(magic):
            if path.suffix != suffix:
                raise RecordingError(f"holds a {kind}, which needs the extension {suffix}")
            return BagRecording(path, [path], kind, topic, options)
    if start.startswith(b"% ") and (has_format(path) or not _TEXT.issuperset(start)):
        return PropheseeRecording(path, options)
    if start.startswith(AEDAT4):
        return Aedat4Recording(path, topic)
    if start.startswith(HDF5):
        return Hdf5Recording(path, options)
    if start.startswith(b"#!AER-DAT"):
        raise RecordingError(f"AEDAT of version {start[9:12].decode('ascii', 'replace')} is not read, only 4.0")
    if start.startswith(COMPRESSED) or _TEXT.issuperset(start.removeprefix(_BYTE_ORDER_MARK)):
        return TextRecording(path, options)
    raise RecordingError(f"not a recording of a known format (it starts with {start[:12]!r})")


def _first_bytes(path: Path) -> bytes:
    with path.open("rb") as file:
        start = file.read(64)
    if not start:
        raise RecordingError(f"{path.name} is empty")
    return start


def _open_folder(path: Path, topic: str | None, options: ReadingOptions) -> Recording:
    files = _files_of(path)
    kinds = {suffix: kind for suffix, kind in _BAG_KINDS.values() if suffix != ".bag"}
    suffixes = {file.suffix for file in files}
    if not files or len(suffixes) != 1 or not suffixes <= kinds.keys():
        names = ", ".join(file.name for file in files)
        raise RecordingError(f"the folder is no ROS 2 bag of .mcap or .db3 files (found: {names or 'none'})")
    for file in files:
        _first_bytes(file)
    return BagRecording(path, files, kinds[files[0].suffix], topic, options)


def _in_order(file: Path) -> list[tuple[int, int, str]]:
    """Key that sorts the numbers in names as numbers: parts of a bag are numbered without zeros before."""
    parts = re.split(r"(\d+)", file.name)
    return [(1, int(part), "") if part.isdecimal() else (0, 0, part) for part in parts]


def _files_of(path: Path) -> list[Path]:
    """Storage files in the order of metadata.yaml; without one, in that of the numbers in their names.

    Its storage identifier is not needed (and empty in some bags): extensions tell.
    """
    metadata = path / "metadata.yaml"
    if not metadata.exists():
        return sorted((file for file in path.iterdir() if file.suffix in (".mcap", ".db3")), key=_in_order)
    try:
        content = yaml.safe_load(metadata.read_text())["rosbag2_bagfile_information"]
        return [path / Path(name).name for name in content["relative_file_paths"]]
    except (OSError, yaml.YAMLError, UnicodeDecodeError, KeyError, TypeError) as error:
        reason = (str(error).splitlines() or [""])[0]
        raise RecordingError(f"metadata.yaml does not describe a bag ({type(error).__name__}: {reason})") from error
