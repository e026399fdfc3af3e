"""Options of the back-end, one frozen dataclass per stage. ROS parameters and `-p` are made from these."""

from __future__ import annotations

from dataclasses import dataclass, field

from esfo_core.options import option


@dataclass(frozen=True)
class SpinRateOptions:
    """How the period is found in the event stream."""

    method: str = option("correlation", "way to the first rate", choices=("correlation", "fourier"))
    fourier_window_s: float = option(
        0.02, "window of the mean x in s (paper, Table 2: FFT sampling window)", 0.001, 1.0
    )
    min_overlap: float = option(0.08, "least share of the recording that two images a lag apart must cover", 0.05, 0.9)
    min_correlation: float = option(0.25, "least correlation of images one period apart", 0.0, 1.0)
    min_prominence: float = option(0.1, "least height of the correlation peak over the valleys beside it", 0.0, 1.0)
    harmonic_z: float = option(5.0, "significance in std by which a period must beat its fractions", 0.0)


@dataclass(frozen=True)
class InitialisationOptions:
    """How the factor graph gets its first values."""

    method: str = option(
        "best",
        "start to use: direct, and the cheaper of both where that leaves a doubt (best); always both; or one",
        choices=("best", "both", "colmap", "direct"),
    )
    axes: int = option(24, "axes over the sphere from which the direct start searches", 4, 500)
    search_tracks: int = option(400, "tracks, the longest of all times, with which it searches", 10)
    cauchy_px: float = option(2.0, "scale of the robust loss in px during the start", 0.1, 100.0)
    min_observations: int = option(4, "rows that a track needs to take part", 2)
    colmap_window_s: float = option(0.03, "time in s that one camera of COLMAP stands for (paper, Table 2)", 0.001, 1.0)
    colmap_min_tracks: float = option(8.0, "mean number of tracks per camera below which COLMAP is not tried", 0.0)
    colmap_max_tracks: int = option(100, "tracks per camera, the longest, that COLMAP gets", 10)
    colmap_max_views: int = option(120, "consecutive cameras, those of the most tracks, that COLMAP gets", 10)
    colmap_min_share: float = option(0.25, "share of the cameras that COLMAP must register", 0.0, 1.0)
    colmap_circle: float = option(0.25, "largest RMS distance of COLMAP's cameras from the circle, in radii", 0.0)
    colmap_rate: float = option(0.1, "largest relative difference of COLMAP's rate from the event stream's", 0.0)


@dataclass(frozen=True)
class ReidentificationOptions:
    """How tracks of the same point are recognised when it comes round again."""

    enabled: bool = option(True, "merge tracks of the same point over time")
    rounds: int = option(4, "merge rounds with the rate fixed, and again with it free", 0, 10)
    neighbours: int = option(12, "nearest points that each point is compared with", 1, 100)
    chi2: float = option(16.0, "largest squared Mahalanobis distance of two points that are one", 0.1)
    rms_px: float = option(1.5, "largest RMS reprojection error in px of a merged point", 0.1)


@dataclass(frozen=True)
class GraphOptions:
    """The factor graph and what counts as a point of the object."""

    cauchy_px: float = option(1.0, "scale of Cauchy's loss in px; 0 is plain least squares (paper)", 0.0, 100.0)
    iterations: int = option(30, "largest number of Levenberg-Marquardt iterations", 1, 1000)
    bias_px: float = option(
        0.25, "standard deviation of the error that all corners share; widens the stated deviations, px", 0.0, 10.0
    )
    prune_px: float = option(2.5, "largest RMS reprojection error in px of a published point", 0.1)


@dataclass(frozen=True)
class VerdictOptions:
    """When a result is trusted."""

    min_points: int = option(10, "points without which there is no estimate", 5)
    min_reobserved: int = option(5, "points that must have been seen again after half a turn or more", 0)
    min_inliers: float = option(0.3, "share of tracks that must follow the motion", 0.0, 1.0)
    max_axis_std_deg: float = option(5.0, "standard deviation of the axis above which it is called degenerate", 0.0)
    rate_slope_z: float = option(4.0, "significance in std at which a slope of the rate counts as one", 0.0)
    max_rate_change: float = option(
        0.005, "change of the rate over the recording, relative, that is called constant", 0.0
    )
    rigidity_z: float = option(4.0, "significance in std at which a wandering axis or centre counts as one", 0.0)
    max_axis_wander_deg: float = option(0.1, "wandering of the axis between thirds of a turn called none, degrees", 0.0)
    max_closure_error_px: float = option(
        0.25, "shift or growth of the image from one turn to the next called none, px", 0.0
    )
    min_revolutions: float = option(1.0, "turns below which nothing confirms the rate", 0.0)
    mirror_ratio: float = option(1.1, "cost ratio of the second optimum below which it is called ambiguous", 1.0)


@dataclass(frozen=True)
class LiveEstimateOptions:
    """When a live estimate is made anew, and from how much."""

    min_revolutions: float = option(1.08, "turns that must have been seen before the first estimate", 0.1)
    interval_s: float = option(0.1, "sensor time in s between two estimates", 0.01)
    search_s: float = option(0.5, "sensor time in s between two searches while there is no estimate", 0.05)
    max_tracks: int = option(500, "tracks that a live estimate is made from", 20)


@dataclass(frozen=True)
class MemoryOptions:
    """What is kept of a long stream. Within these limits nothing is left out."""

    max_bins: int = option(24_000, "bins of activity; beyond, the latest or coarser ones", 1000)
    revolutions: float = option(
        16.0, "revolutions that the latest bins must hold for earlier ones to be forgotten", 2.0
    )
    max_observations: int = option(
        1_000_000, "rows of tracks; beyond, the longest tracks of every part of the time", 1000
    )


@dataclass(frozen=True)
class ScaleOptions:
    """A known length makes the result metric; at most one of them, 0 is unknown."""

    distance_m: float = option(0.0, "distance from the camera to the object's centre, m", 0.0)
    radius_m: float = option(0.0, "radius of the orbit, which is the camera's distance from the spin axis, m", 0.0)
    size_m: float = option(0.0, "largest distance between two points of the object, m", 0.0)


@dataclass(frozen=True)
class BackendOptions:
    """All options of the back-end."""

    rate: SpinRateOptions = field(default_factory=SpinRateOptions)
    initialisation: InitialisationOptions = field(default_factory=InitialisationOptions)
    reidentification: ReidentificationOptions = field(default_factory=ReidentificationOptions)
    graph: GraphOptions = field(default_factory=GraphOptions)
    verdict: VerdictOptions = field(default_factory=VerdictOptions)
    live: LiveEstimateOptions = field(default_factory=LiveEstimateOptions)
    memory: MemoryOptions = field(default_factory=MemoryOptions)
    scale: ScaleOptions = field(default_factory=ScaleOptions)


PRESETS: dict[str, BackendOptions] = {
    "default": BackendOptions(),
    "paper": BackendOptions(
        rate=SpinRateOptions(method="fourier"),
        initialisation=InitialisationOptions(method="colmap", colmap_max_tracks=10**9, colmap_max_views=10**9),
        reidentification=ReidentificationOptions(enabled=False),
        graph=GraphOptions(cauchy_px=0.0),
    ),
}
"""`paper`: the method as printed; it fails where COLMAP fails."""
