"""COLMAP's start on the tracks that the front-end makes of simulated events."""

from esfo_backend.adjustment.bundle_adjustment import bundle_adjustment, linear_points
from esfo_backend.initialise.colmap import run_colmap
from esfo_backend.options import InitialisationOptions
from esfo_backend.orbit.observations import observations
from esfo_backend.orbit.parametrization import Motion
from esfo_core.orbit import angle_between
from esfo_core.tracks import Tracks
from esfo_frontend.frontend import Frontend
from esfo_simulation.scene import SceneOptions, simulate


def test_colmap_leads_to_the_truth():
    scene = simulate(SceneOptions(revolutions=1.0))
    frontend = Frontend(scene.camera)
    outputs = [frontend.process(events) for events in scene.chunks()] + [frontend.flush()]
    tracks = Tracks.concatenate(output.tracks.observations for output in outputs)
    start = run_colmap(tracks, scene.camera, InitialisationOptions())
    # Its cameras drift, but they are an orbit, and near enough for the orbit model to find the way from there.
    assert start.registered > 0.4 * start.views
    assert start.rms_px < 1.5
    assert start.orbit.circle_residual < 0.25
    assert angle_between(start.orbit.motion.axis, scene.spin.axis) < 15
    obs, _ = observations(tracks, scene.camera, 4)
    motion = Motion(start.orbit.motion.Q, scene.spin.rate_hz)
    refined = bundle_adjustment(motion, linear_points(motion, obs), obs, 2.0, free_rate=False)
    assert angle_between(refined.motion.axis, scene.spin.axis) < 1.0
