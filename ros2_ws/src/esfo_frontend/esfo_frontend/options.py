"""Options of every stage of the front-end, with the two presets."""

from __future__ import annotations

from dataclasses import dataclass, field

from esfo_core.errors import OptionError
from esfo_core.options import check, option

MILLISECOND = 1_000_000
"""One millisecond in nanoseconds."""


@dataclass(frozen=True)
class CornerOptions:
    """Detector, and lengths of the newest arc on the two circles, in ring pixels.

    eFAST: Mueggler et al., BMVC 2017; Arc*: Alzugaray and Chli, RA-L 2018.
    """

    detector: str = option("efast", "corner detector: eFAST, as in the paper, or Arc*", choices=("efast", "arc_star"))
    shortest_inner: int = option(3, "shortest corner arc on the circle of radius 3, of 16 pixels", 1, 15)
    longest_inner: int = option(6, "longest corner arc on the circle of radius 3, of 16 pixels", 1, 15)
    shortest_outer: int = option(4, "shortest corner arc on the circle of radius 4, of 20 pixels", 1, 19)
    longest_outer: int = option(8, "longest corner arc on the circle of radius 4, of 20 pixels", 1, 19)
    kappa: float = option(
        50.0, "Arc*: time within which events of equal polarity at a pixel are ignored, ms; 0: none", 0.0, 10_000.0
    )
    threads: int = option(1, "eFAST: number of threads; 2: one per polarity, with the same result", 1, 2)


@dataclass(frozen=True)
class DensityOptions:
    """Filter on the local event density, D(e) of equation 2."""

    radius: float = option(7.0, "lambda: neighbourhood radius in (x, y, scaled t), px", 0.5, 50.0)
    memory: float = option(
        10.0, "time constant of the running mean density of each polarity, s; 0: mean of all corners", 0.0, 1e6
    )


@dataclass(frozen=True)
class ClusterOptions:
    """HDBSCAN in overlapping chunks of fixed duration.

    Longer chunks cost more for each corner and delay the tracks. In shorter ones features with few corners merge with
    their neighbours, since minPts corners then spread over most of a chunk.
    """

    min_size: int = option(10, "minPts: smallest number of corners of a cluster within one chunk", 2, 10_000)
    epsilon: float = option(
        0.0, "clusters closer than this distance in (x, y, scaled t) are not split, px", 0.0, 1000.0
    )
    chunk: float = option(120.0, "duration of a chunk, ms", 1.0, 60_000.0)
    shared: float = option(20.0, "overlap of consecutive chunks, ms; at most half a chunk", 0.0, 30_000.0)
    algorithm: str = option(
        "boruvka",
        "HDBSCAN implementation: built in (boruvka) or package `hdbscan` (slower; differs only for equal edges)",
        choices=("boruvka", "hdbscan"),
    )


@dataclass(frozen=True)
class JoinOptions:
    """Head to tail joining of clusters (section 4.2)."""

    radius: float = option(5.0, "phi: radius of the forward hemisphere in (x, y, scaled t), px", 0.0, 1000.0)
    descriptor_size: int = option(
        5, "N_sigma: number of corners averaged for the head and the tail of a cluster", 1, 1000
    )


@dataclass(frozen=True)
class AssociationOptions:
    """Association of corners with tracks by prediction. All lengths are pixels of the image: they serve any speed."""

    gate: float = option(
        2.5, "largest distance from a corner to the predicted position of its track, px", 0.1, 50.0, common=True
    )
    spacing: float = option(
        4.0, "smallest distance from a new track to an existing one of the same polarity, px; 0: none", 0.0, 50.0
    )
    memory: float = option(
        4.0, "image motion after which the weight of a corner in the track's fit has fallen to 1/e, px", 0.1, 1000.0
    )
    coast: float = option(4.0, "predicted image motion without a corner after which a track ends, px", 0.1, 50.0)
    wait: float = option(
        5.0,
        "image motion of the typical track, during a gap of a slow track, after which the slow one ends, px",
        0.1,
        1000.0,
    )
    longest_gap: float = option(300.0, "time without a corner after which any track ends, ms", 0.1, 60_000.0)
    step: float = option(4.0, "image motion over which corners are averaged into one observation, px", 0.1, 100.0)
    lag: float = option(
        0.6,
        "distance by which corner events trail the corner; observations are corrected by it, px",
        0.0,
        10.0,
        common=True,
    )
    first_corners: int = option(10, "number of corners of a track before its first observation", 2, 10_000)
    slice: float = option(10.0, "time slice in which corners are processed together, ms", 0.1, 1000.0)


@dataclass(frozen=True)
class TrackOptions:
    """Window means of the joined clusters (section 4.3, equation 4)."""

    window: float = option(30.0, "delta t: duration of a window, ms", 0.1, 60_000.0)
    min_corners: int = option(
        3, "smallest number of corners of an observation; windows with fewer are dropped", 1, 1000
    )
    min_sigma: float = option(0.35, "smallest standard deviation of an observation, px", 0.01, 10.0)
    corner_sigma: float = option(1.0, "standard deviation of a single corner about its track, px", 0.01, 50.0)


@dataclass(frozen=True)
class ActivityOptions:
    """Coarse event counts, from which the back-end finds the period."""

    bin: float = option(5.0, "duration of a time bin, ms", 0.1, 10_000.0)
    cell: int = option(32, "edge of a square cell, px", 1, 4096)


@dataclass(frozen=True)
class FrontendOptions:
    """Options of the whole front-end.

    The paper measures distances in (x, y, t) without saying the unit of t. Here time is multiplied by one scale for
    the density, the clusters and the joining alike; 1000 px/s is time in milliseconds.
    """

    tracker: str = option(
        "association",
        "association: nearest predicted track; clusters: density filter, HDBSCAN and joining (paper)",
        choices=("association", "clusters"),
        common=True,
    )
    time_scale: float = option(300.0, "scale from time to pixels in distances of (x, y, t), px/s", 0.1, 1e6)
    corners: CornerOptions = field(default_factory=CornerOptions)
    density: DensityOptions = field(default_factory=DensityOptions)
    clusters: ClusterOptions = field(default_factory=ClusterOptions)
    join: JoinOptions = field(default_factory=JoinOptions)
    association: AssociationOptions = field(default_factory=AssociationOptions)
    tracks: TrackOptions = field(default_factory=TrackOptions)
    activity: ActivityOptions = field(default_factory=ActivityOptions)


PRESETS: dict[str, FrontendOptions] = {
    "default": FrontendOptions(),
    "paper": FrontendOptions(
        tracker="clusters",
        time_scale=1000.0,
        density=DensityOptions(memory=0.0),
        clusters=ClusterOptions(epsilon=5.0, algorithm="hdbscan"),
        join=JoinOptions(radius=30.0),
        tracks=TrackOptions(min_corners=1, min_sigma=0.25),
    ),
}
"""`paper` has the values of Table 2; `default` is what tracked simulated scenes with known motion better."""


def check_options(options: FrontendOptions) -> None:
    """Raise OptionError for a value outside its range or values that contradict each other."""
    check(options)
    clusters, corners = options.clusters, options.corners
    if clusters.shared > clusters.chunk / 2:
        raise OptionError(f"clusters.shared is {clusters.shared} ms, more than half of clusters.chunk {clusters.chunk}")
    if corners.detector == "arc_star" and corners.threads > 1:
        raise OptionError("corners.threads is 2, but in Arc* the polarities depend on each other")
    if corners.shortest_inner > corners.longest_inner:
        raise OptionError(f"corners.shortest_inner is {corners.shortest_inner}, above {corners.longest_inner}")
    if corners.shortest_outer > corners.longest_outer:
        raise OptionError(f"corners.shortest_outer is {corners.shortest_outer}, above {corners.longest_outer}")


def check_for_sensor(options: FrontendOptions, width: int, height: int) -> None:
    """Raise OptionError as `check_options`, or for a length in the image that is longer than its longer side."""
    check_options(options)
    lengths = {
        "activity.cell": options.activity.cell,
        "association.gate": options.association.gate,
        "association.spacing": options.association.spacing,
        "association.coast": options.association.coast,
        "association.step": options.association.step,
    }
    for name, length in lengths.items():
        if length > max(width, height):
            raise OptionError(f"{name} is {length} px, longer than the sensor of {width}x{height}")


def nanoseconds(milliseconds: float) -> int:
    """Return a duration of the options as whole nanoseconds."""
    return round(milliseconds * MILLISECOND)
