"""Opening of a path as a recording, by the format of its contents."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import yaml

from esfo_core.errors import CameraError, RecordingError
from esfo_core.recordings.aedat2 import MAGIC as AEDAT2
from esfo_core.recordings.aedat2 import Aedat2Recording
from esfo_core.recordings.aedat4 import MAGIC as AEDAT4
from esfo_core.recordings.aedat4 import Aedat4Recording
from esfo_core.recordings.bag import BagRecording
from esfo_core.recordings.byte_stream import COMPRESSED
from esfo_core.recordings.event_stream import MAGIC as EVENT_STREAM
from esfo_core.recordings.event_stream import EventStreamRecording
from esfo_core.recordings.hdf5 import MAGIC as HDF5
from esfo_core.recordings.hdf5 import Hdf5Recording
from esfo_core.recordings.numpy_files import MAGIC as NUMPY
from esfo_core.recordings.numpy_files import NumpyRecording, is_npz
from esfo_core.recordings.prophesee import PropheseeRecording, has_format
from esfo_core.recordings.reading_options import ReadingOptions
from esfo_core.recordings.recording import Recording
from esfo_core.recordings.text import TextRecording
from esfo_core.recordings.unpacking import PACKED, SUFFIXES, is_archive, names_in, packed_start, plain_name, unpack

_BAG_KINDS = {
    b"\x89MCAP0\r\n": (".mcap", "ROS 2 bag (MCAP)"),
    b"SQLite format 3\0": (".db3", "ROS 2 bag (SQLite)"),
    b"#ROSBAG V2.0\n": (".bag", "ROS 1 bag"),
}

_TEXT = frozenset(range(32, 127)) | frozenset("\t\r\nµ".encode())
_BYTE_ORDER_MARK = b"\xef\xbb\xbf"
_RECORDING_SUFFIXES = (
    ".raw",
    ".dat",
    ".mcap",
    ".db3",
    ".bag",
    ".aedat4",
    ".aedat",
    ".h5",
    ".hdf5",
    ".npy",
    ".npz",
    ".es",
)
_NOTHING_TOLD = ReadingOptions()


def open_recording(path: Path, topic: str | None = None, options: ReadingOptions = _NOTHING_TOLD) -> Recording:
    """Open an event recording of any known format, told by its first bytes.

    path: a ROS 2 bag (folder, `.mcap` or `.db3` file), a ROS 1 bag (`.bag`), a Prophesee RAW (EVT2, EVT2.1, EVT3) or
    DAT file, an AEDAT 2.0 or 4 file, an Event Stream, an HDF5 or NumPy file, or text; any of these plain or compressed
    as a whole.
    topic: which event topic of a bag or stream of an AEDAT4 file, needed only when it has several.
    options: what the file does not tell.

    Raises RecordingError when there is nothing to read at `path` or it is not of a known format, and CameraError when
    the calibration in a bag is impossible.
    """
    try:
        recording = _open(path, topic, options)
    except (RecordingError, CameraError) as error:
        raise type(error)(f"{path}: {error}") from error
    except OSError as error:
        raise RecordingError(f"{error.filename or path}: {error.strerror or error}") from error
    recording.wanted_segment = options.segment
    return recording


def _open(path: Path, topic: str | None, options: ReadingOptions) -> Recording:
    if path.is_dir():
        return _open_folder(path, topic, options)
    if path.exists() and not path.is_file():
        return _from_pipe(path, topic, options)
    start = _first_bytes(path)
    if start.startswith(PACKED) and not (start.startswith(b"PK") and is_npz(path)) and not _is_packed_text(path):
        folder = TemporaryDirectory(prefix="esfo_")
        inner = _with_its_suffix(unpack(path, Path(folder.name)))
        recording = _open(inner, topic, options)
        recording.unpacked_from = path
        recording.unpacked_to.append(folder)
        return recording
    return _open_file(path, start, topic, options)


def _from_pipe(path: Path, topic: str | None, options: ReadingOptions) -> Recording:
    """Read a pipe to its end first: recordings are read from their start more than once."""
    if not path.is_fifo():
        raise RecordingError("is neither a file, nor a folder, nor a pipe")
    folder = TemporaryDirectory(prefix="esfo_")
    copy = Path(folder.name) / path.name
    with path.open("rb") as pipe, copy.open("wb") as out:
        shutil.copyfileobj(pipe, out)
    recording = _open(_with_its_suffix(copy), topic, options)
    recording.unpacked_from = path
    recording.unpacked_to.append(folder)
    return recording


def _is_packed_text(path: Path) -> bool:
    """Whether a compressed file holds text of events, which is read without unpacking it first."""
    start = packed_start(path, 512)
    if not start:  # a ZIP archive
        return not any(name.lower().endswith(_RECORDING_SUFFIXES) for name in names_in(path))
    known = (*_BAG_KINDS, b"% ", b"#!AER-DAT", EVENT_STREAM)
    compressed_stream = _first_bytes(path).startswith(COMPRESSED)
    return compressed_stream and not is_archive(start) and not start.startswith(known) and b"\0" not in start


def _with_its_suffix(path: Path) -> Path:
    """Give an unpacked bag file the extension that its kind needs."""
    if path.is_dir():
        return path
    start = _first_bytes(path)
    suffix = next((suffix for magic, (suffix, _) in _BAG_KINDS.items() if start.startswith(magic)), path.suffix)
    return path if path.suffix == suffix else path.rename(path.with_name(path.name + suffix))


def _open_file(path: Path, start: bytes, topic: str | None, options: ReadingOptions) -> Recording:
    for magic, (suffix, kind) in _BAG_KINDS.items():
        if start.startswith(magic):
            if path.suffix != suffix:
                raise RecordingError(f"holds a {kind}, which needs the extension {suffix}")
            return BagRecording(path, [path], kind, topic, options)
    opener = next((opener for magic, opener in _OPENERS.items() if start.startswith(magic)), None)
    if opener is not None:
        return opener(path, topic, options)
    if start.startswith(b"% ") and (has_format(path) or not _TEXT.issuperset(start)):
        return PropheseeRecording(path, options)
    if start.startswith(COMPRESSED) or _TEXT.issuperset(start.removeprefix(_BYTE_ORDER_MARK)):
        return TextRecording(path, options)
    raise RecordingError(f"not a recording of a known format (it starts with {start[:12]!r})")


def _open_zip(path: Path, topic: str | None, options: ReadingOptions) -> Recording:
    return NumpyRecording(path, options) if is_npz(path) else TextRecording(path, options)


def _refuse_aedat(path: Path, topic: str | None, options: ReadingOptions) -> Recording:
    version = _first_bytes(path)[9:12].decode("ascii", "replace")
    raise RecordingError(f"AEDAT of version {version} is not read, only 2.0 and 4.0")


_OPENERS: dict[bytes, Callable[[Path, str | None, ReadingOptions], Recording]] = {
    AEDAT4: lambda path, topic, options: Aedat4Recording(path, topic),
    AEDAT2: lambda path, topic, options: Aedat2Recording(path, options),
    b"#!AER-DAT": _refuse_aedat,
    HDF5: Hdf5Recording,
    NUMPY: lambda path, topic, options: NumpyRecording(path, options),
    b"PK": _open_zip,
    EVENT_STREAM: lambda path, topic, options: EventStreamRecording(path),
}
"""Readers by the first bytes of a file."""


def _first_bytes(path: Path) -> bytes:
    with path.open("rb") as file:
        start = file.read(64)
    if not start:
        raise RecordingError(f"{path.name} is empty")
    return start


def _open_folder(path: Path, topic: str | None, options: ReadingOptions) -> Recording:
    files, folder = _files_of(path), None
    if any(file.suffix in SUFFIXES for file in files):  # compression_mode FILE
        folder = TemporaryDirectory(prefix="esfo_")
        files = [unpack(file, Path(folder.name)) if file.suffix in SUFFIXES else file for file in files]
    kinds = {suffix: kind for suffix, kind in _BAG_KINDS.values() if suffix != ".bag"}
    suffixes = {file.suffix for file in files}
    if not files or len(suffixes) != 1 or not suffixes <= kinds.keys():
        names = ", ".join(file.name for file in files)
        raise RecordingError(f"the folder is no ROS 2 bag of .mcap or .db3 files (found: {names or 'none'})")
    for file in files:
        _first_bytes(file)
    recording = BagRecording(path, files, kinds[files[0].suffix], topic, options)
    recording.unpacked_to += [folder] if folder else []
    return recording


def _is_part(file: Path) -> bool:
    return Path(plain_name(file)).suffix in (".mcap", ".db3")


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
        return sorted((file for file in path.iterdir() if _is_part(file)), key=_in_order)
    try:
        content = yaml.safe_load(metadata.read_text())["rosbag2_bagfile_information"]
        return [path / Path(name).name for name in content["relative_file_paths"]]
    except (OSError, yaml.YAMLError, UnicodeDecodeError, KeyError, TypeError) as error:
        reason = (str(error).splitlines() or [""])[0]
        raise RecordingError(f"metadata.yaml does not describe a bag ({type(error).__name__}: {reason})") from error
