"""What the steps of a run return."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from matplotlib.figure import Figure

from esfo_bringup.offline.pipeline import RunResult
from esfo_bringup.offline.source import Source
from esfo_bringup.results.event_image import EventImage
from esfo_bringup.results.figures import draw_events
from esfo_bringup.results.files import write_results
from esfo_bringup.settings import RunSettings
from esfo_core.activity import Activity
from esfo_core.estimate import OrbitEstimate
from esfo_core.estimate_text import printed_facts
from esfo_core.tracks import Tracks, TrackUpdate
from esfo_frontend.trackers import Statistics

Update = tuple[TrackUpdate, Activity | None, tuple[Activity, ...]]
"""What `Backend.add` takes: tracks, activity and pieces of the activity pyramid."""


@dataclass(frozen=True)
class TrackedRecording:
    """A recording after the front-end.

    tracks: all observations, sorted by track, then time. statistics: what the front-end counted. updates: what each
    chunk of events settled, in order, for the back-end. image: event counts for the figures.
    """

    source: Source
    settings: RunSettings
    tracks: Tracks
    statistics: Statistics
    updates: tuple[Update, ...] = field(repr=False)
    image: EventImage = field(repr=False)


@dataclass(frozen=True)
class Result:
    """Outcome of a run; printed, it reads as `esfo run` prints it."""

    tracked: TrackedRecording
    outcome: RunResult

    @property
    def estimate(self) -> OrbitEstimate:
        """Status, flags, spin, structure and standard deviations."""
        return self.outcome.estimate

    @property
    def tracks(self) -> Tracks:
        """All observations, sorted by track, then time."""
        return self.outcome.tracks

    def plot(self) -> Figure:
        """Draw events, projected axis and points, and the structure about the axis, as `axis.png` of `esfo run`."""
        return draw_events(self.estimate, self.tracked.source.camera, self.tracked.image)

    def save(self, folder: str | Path) -> None:
        """Write the files of `esfo run` but result.mcap into a folder, which is made.

        Raises EsfoError when a file cannot be written, OSError a picture.
        """
        activity = [piece for _, piece, _ in self.tracked.updates if piece is not None]
        write_results(self.outcome, self.tracked.source, self.tracked.image, activity, Path(folder))

    def __str__(self) -> str:
        return "\n".join(printed_facts(self.estimate, self.outcome.note))
