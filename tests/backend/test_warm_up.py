"""Nothing is left to compile when the first live estimate is made."""

from scenes import CAMERA, NONE_ENDED, spin, tracks_of, unit

from esfo_backend.adjustment import bundle_adjustment as adjust
from esfo_backend.adjustment import consider_bias
from esfo_backend.backend import Backend
from esfo_backend.orbit import projection
from esfo_backend.spin_rate import correlation as spin_rate
from esfo_backend.warm_up import warm_up
from esfo_core.tracks import TrackUpdate
from esfo_simulation.activity import synthetic_activity


def compiled():
    modules = (adjust, consider_bias, projection, spin_rate)
    kernels = [f for m in modules for f in vars(m).values() if hasattr(f, "signatures")]
    return {f.__name__: len(f.signatures) for f in kernels}


def test_a_live_estimate_compiles_nothing():
    warm_up()
    before = compiled()
    assert before["_levenberg_marquardt"] > 0
    scene = tracks_of(spin(unit(0.3, -0.8, 0.4)), noise_px=0.5, outliers=0.1)
    backend = Backend(CAMERA)
    backend.add(TrackUpdate(scene.tracks, NONE_ENDED), synthetic_activity(scene.spin, scene.points, CAMERA, 4.0))
    assert backend.solve(thorough=False).status == "ok"
    assert "initialisation" not in backend.solve(thorough=False).timing_s
    assert compiled() == before
