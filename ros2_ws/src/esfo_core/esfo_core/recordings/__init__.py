"""Recordings of events: opening any known file, and writing ROS 2 bags."""

from esfo_core.recordings.mcap_writer import write_mcap
from esfo_core.recordings.opening import open_recording
from esfo_core.recordings.reading_options import ReadingOptions
from esfo_core.recordings.recording import Recording, RecordingStatistics

__all__ = ["ReadingOptions", "Recording", "RecordingStatistics", "open_recording", "write_mcap"]
