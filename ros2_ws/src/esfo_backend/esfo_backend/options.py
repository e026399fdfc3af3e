"""Options of the back-end, one frozen dataclass per stage. ROS parameters and `-p` are made from these."""

from __future__ import annotations

from dataclasses import dataclass, field

from esfo_core.options import option


@dataclass(frozen=True)
class SpinRateOptions:
    """How the period is found in the event stream."""

    method: str = option("correlation", "estimator of the initial spin rate", choices=("correlation", "fourier"))
    fourier_window_s: float = option(0.02, "sampling window of the FFT of the mean x, s (paper, Table 2)", 0.001, 1.0)
    min_overlap: float = option(
        0.08, "smallest share of the recording over which images one lag apart overlap", 0.05, 0.9
    )
    min_correlation: float = option(0.25, "smallest correlation of event images one period apart", 0.0, 1.0)
    min_prominence: float = option(
        0.1, "smallest height of the correlation peak above the neighbouring minima", 0.0, 1.0
    )
    harmonic_z: float = option(
        5.0, "significance, in standard deviations, at which a fraction of the period is rejected", 0.0
    )


@dataclass(frozen=True)
class InitialisationOptions:
    """How the factor graph gets its first values."""

    method: str = option(
        "best",
        "axis search, and COLMAP too where the search is ambiguous (best); both; or only one (colmap, direct)",
        choices=("best", "both", "colmap", "direct"),
        common=True,
    )
    axes: int = option(24, "number of initial axes, spread over the sphere, for the axis search", 4, 500)
    search_tracks: int = option(400, "largest number of tracks used by the axis search", 10)
    cauchy_px: float = option(2.0, "scale of the Cauchy loss during initialisation, px", 0.1, 100.0)
    min_observations: int = option(4, "smallest number of observations of a track that is used", 2)
    colmap_window_s: float = option(0.03, "time window of one COLMAP view, s (paper, Table 2)", 0.001, 1.0)
    colmap_min_tracks: float = option(8.0, "smallest mean number of tracks per view for which COLMAP is run", 0.0)
    colmap_max_tracks: int = option(100, "largest number of tracks per view given to COLMAP; the longest are kept", 10)
    colmap_max_views: int = option(
        120, "largest number of consecutive views given to COLMAP; those with the most tracks are kept", 10
    )
    colmap_min_share: float = option(0.25, "smallest share of the views that COLMAP must register", 0.0, 1.0)
    colmap_circle: float = option(0.25, "largest RMS distance of COLMAP's views from the fitted circle, in radii", 0.0)
    colmap_rate: float = option(
        0.1, "largest relative difference between COLMAP's rate and that of the event stream", 0.0
    )


@dataclass(frozen=True)
class ReidentificationOptions:
    """How tracks of the same point are recognised when it comes round again."""

    enabled: bool = option(True, "merge tracks of the same point from different revolutions")
    rounds: int = option(4, "number of merge rounds with the rate fixed, and again with the rate free", 0, 10)
    neighbours: int = option(12, "number of nearest points with which each point is compared", 1, 100)
    chi2: float = option(16.0, "largest squared Mahalanobis distance between two points to merge", 0.1)
    rms_px: float = option(1.5, "largest RMS reprojection error of a merged point, px", 0.1)


@dataclass(frozen=True)
class GraphOptions:
    """The factor graph and what counts as a point of the object."""

    cauchy_px: float = option(1.0, "scale of the Cauchy loss, px; 0: least squares, as in the paper", 0.0, 100.0)
    iterations: int = option(30, "largest number of Levenberg-Marquardt iterations", 1, 1000)
    bias_px: float = option(
        0.25,
        "standard deviation of the corner bias common to all points; added to the reported covariance, px",
        0.0,
        10.0,
        common=True,
    )
    prune_px: float = option(2.5, "largest RMS reprojection error of a point that is kept, px", 0.1)


@dataclass(frozen=True)
class VerdictOptions:
    """When a result is trusted."""

    min_points: int = option(10, "smallest number of points for an estimate", 5)
    min_reobserved: int = option(5, "smallest number of points observed again after half a revolution or more", 0)
    min_inliers: float = option(0.3, "smallest share of tracks that fit the motion", 0.0, 1.0)
    max_axis_std_deg: float = option(
        5.0, "largest standard deviation of the axis of a result that is `ok`, degrees", 0.0
    )
    rate_slope_z: float = option(4.0, "significance, in standard deviations, at which a rate slope is reported", 0.0)
    max_rate_change: float = option(
        0.005, "largest relative change of the rate over the recording that counts as constant", 0.0
    )
    rigidity_z: float = option(
        4.0, "significance, in standard deviations, at which axis wander or closure error is reported", 0.0
    )
    max_axis_wander_deg: float = option(
        0.1, "largest wander of the axis between thirds of a revolution for a rigid rotation, degrees", 0.0
    )
    max_closure_error_px: float = option(
        0.25, "largest shift or scaling of the image over one revolution for a rigid rotation, px", 0.0
    )
    min_revolutions: float = option(
        1.0, "smallest number of revolutions, measured by the tracks, of a result that is `ok`", 0.0
    )
    rate_z: float = option(
        3.0, "standard errors by which the tracks must fit the rate better than its multiples and fractions", 0.0
    )
    mirror_ratio: float = option(
        1.1, "cost ratio of second to best optimum below which the result is flagged as ambiguous", 1.0
    )


@dataclass(frozen=True)
class LiveEstimateOptions:
    """When a live estimate is made anew, and from how much."""

    min_revolutions: float = option(1.08, "number of revolutions before the first estimate", 0.1)
    interval_s: float = option(0.1, "sensor time between two estimates, s", 0.01, common=True)
    search_s: float = option(0.5, "sensor time between two searches while there is no estimate, s", 0.05)
    max_tracks: int = option(500, "largest number of tracks in an incremental estimate", 20)


@dataclass(frozen=True)
class MemoryOptions:
    """What is kept of a long stream. Within these limits nothing is left out."""

    max_bins: int = option(
        24_000, "largest number of activity bins; then old bins are dropped or bins are merged in pairs", 1000
    )
    revolutions: float = option(16.0, "number of revolutions that must remain before old bins are dropped", 2.0)
    max_observations: int = option(
        1_000_000, "largest number of track observations; then the shortest tracks are dropped", 1000
    )


@dataclass(frozen=True)
class ScaleOptions:
    """A known length makes the result metric; at most one of them, 0 is unknown."""

    distance_m: float = option(0.0, "distance from the camera to the object's centre, m", 0.0, common=True)
    radius_m: float = option(0.0, "orbit radius: distance from the camera to the spin axis, m", 0.0, common=True)
    size_m: float = option(0.0, "largest distance between two points of the object, m", 0.0, common=True)


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
