"""Which verdict simulated scenes get that are no fixed axis at a constant rate, and which those get that are."""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np
from provenance import print_provenance

from esfo_backend.options import BackendOptions, InitialisationOptions
from esfo_bringup.benchmark.orbit_accuracy import backend_of, track
from esfo_core.estimate import OrbitEstimate
from esfo_core.orbit import angle_between
from esfo_simulation.scene import MotionOptions, Scene, SceneOptions, simulate

Change = dict[str, object]

CASES: dict[str, list[Change]] = {
    "ok": [
        {"object": "tdrs", "view": "sideon", "revolutions": 1.6},
        {"object": "camera", "revolutions": 1.45},
        {"object": "dualshock", "view": "perpendicular", "revolutions": 4.0},
        {"view": "custom", "elevation_deg": 75.0, "roll_deg": 20.0},
        {"object": "soho", "view": "topdown"},
        {"object": "switch", "view": "sideon"},
    ],
    "not_a_rotation": [
        {"nutation_deg": 5},
        {"nutation_deg": 20},
        {"nutation_deg": 45},
        {"object": "soho", "nutation_deg": 12, "inertia_ratio": 1.3},
        {"object": "tdrs", "view": "sideon", "nutation_deg": 8, "inertia_ratio": 0.6},
        {"object": "camera", "view": "topdown", "nutation_deg": 3, "inertia_ratio": 1.4},
        {"object": "dualshock", "view": "perpendicular", "speed": "medium", "nutation_deg": 30, "inertia_ratio": 0.9},
        {"far": 1.5, "velocity_x_m_s": 0.03},
        {"far": 1.3, "velocity_x_m_s": 0.005},
        {"far": 1.5, "velocity_z_m_s": 0.05},
        {"object": "soho", "view": "sideon", "far": 1.4, "velocity_y_m_s": 0.02},
        {"object": "tdrs", "far": 1.3, "velocity_x_m_s": -0.01},
        {"object": "camera", "view": "sideon", "far": 1.3, "velocity_z_m_s": 0.02},
        {"object": "dualshock", "far": 1.6, "velocity_y_m_s": 0.04},
        {"speed": "still", "duration_s": 2.0, "far": 1.6, "velocity_x_m_s": 0.05},
        {"speed": "still", "duration_s": 2.0, "far": 1.6, "velocity_z_m_s": -0.2},
        {"object": "camera", "speed": "still", "duration_s": 2.0, "far": 1.8, "velocity_y_m_s": 0.08},
        {
            "object": "dualshock",
            "speed": "still",
            "duration_s": 2.0,
            "far": 1.8,
            "velocity_x_m_s": 0.05,
            "velocity_z_m_s": -0.1,
        },
        {"speed": "still", "duration_s": 2.0},
        {"object": "switch", "speed": "still", "duration_s": 3.0},
        {"far": 1.3, "velocity_x_m_s": 0.0015},
        {"object": "camera", "view": "sideon", "far": 1.3, "velocity_z_m_s": 0.004},
        {"object": "tdrs", "view": "perpendicular", "nutation_deg": 2, "inertia_ratio": 0.8},
        {
            "object": "switch",
            "speed": "still",
            "duration_s": 2.0,
            "far": 1.8,
            "velocity_y_m_s": -0.04,
            "velocity_z_m_s": 0.15,
        },
    ],
    "rate_not_constant": [
        {"rate_slope_hz_s": -0.19},
        {"rate_slope_hz_s": -0.1},
        {"rate_slope_hz_s": 0.02},
        {"object": "soho", "view": "sideon", "rate_slope_hz_s": 0.05},
        {"object": "switch", "view": "topdown", "rate_slope_hz_s": -0.03},
        {"object": "tdrs", "view": "sideon", "rate_slope_hz_s": 0.15},
        {"object": "camera", "view": "perpendicular", "speed": "medium", "rate_slope_hz_s": -0.01},
        {"object": "dualshock", "speed": "medium", "revolutions": 2.2, "rate_slope_hz_s": -0.04},
    ],
    "too_few_turns": [
        {"revolutions": 0.4},
        {"revolutions": 0.8},
        {"object": "camera", "revolutions": 0.6},
        {"object": "switch", "view": "topdown", "revolutions": 0.9},
        {"object": "dualshock", "view": "sideon", "revolutions": 0.9},
        {"object": "soho", "view": "sideon", "revolutions": 0.7},
        {"object": "tdrs", "view": "perpendicular", "revolutions": 0.95},
    ],
    "axis_unobservable": [
        {"view": "custom", "elevation_deg": 88.0, "roll_deg": 20.0},
        {"object": "dualshock", "view": "custom", "elevation_deg": 89.7},
    ],
}
"""What is changed of a scene of 346x260 px, 1 Hz, 2.5 turns. far: distance over the default one; velocities are in
default distances per second."""


def scene_of(change: Change) -> Scene:
    """Set a case up."""
    options = SceneOptions(width=346, height=260, speed="fast")
    motion = {k: v for k, v in change.items() if k in MotionOptions.__dataclass_fields__}
    rest = {k: v for k, v in change.items() if k not in motion and k != "far"}
    options = replace(options, **rest)  # type: ignore[arg-type]
    if "far" in change:
        distance = float(np.linalg.norm(simulate(options if options.spin_rate_hz else still(options)).spin.center))
        options = replace(options, distance_m=float(change["far"]) * distance)  # type: ignore[arg-type]
        motion = {k: float(v) * distance if "velocity" in k else v for k, v in motion.items()}  # type: ignore[arg-type]
    return simulate(replace(options, motion=MotionOptions(**motion)))  # type: ignore[arg-type]


def still(options: SceneOptions) -> SceneOptions:
    """Return a scene at the same distance that spins: the distance does not depend on the motion."""
    return replace(options, speed="fast", duration_s=0.0)


def solve(scene: Scene) -> OrbitEstimate:
    """Run the pipeline, without COLMAP, which decides no verdict."""
    options = BackendOptions(initialisation=InitialisationOptions(method="direct"))
    return backend_of(track(scene.chunks(), scene.camera), scene.camera, options).solve()


def main() -> None:
    """Print a line for each case, and the confusion."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", action="append", choices=tuple(CASES), help="only these; may be repeated")
    kinds = parser.parse_args().kind or tuple(CASES)
    print_provenance()
    print("| truth | scene | status | flags | rate, Hz: true, found | slope, Hz/s: true, found | axis off, deg |")
    print("|---|---|---|---|---|---|---|")
    counts = {}
    for kind in kinds:
        named = doubted = 0
        for change in CASES[kind]:
            scene = scene_of(change)
            e = solve(scene)
            flags = [f for f in e.flags if f != "scale_unobservable"]
            doubted += e.status != "ok"
            named += kind in flags or kind == e.status
            label = ", ".join(f"{k.split('_m_s')[0]} {v}" for k, v in change.items())
            found = "| | | |"
            if e.spin is not None:
                true = scene.motion.rate_hz(np.array(float(e.spin.t0)))
                slope = f"{scene.motion.slope_hz_s:g}, {e.rate_slope_hz_s:.5f} +- {e.rate_slope_std_hz_s:.5f}"
                off = angle_between(e.spin.axis, scene.spin.axis)
                found = f"| {true:.4f}, {e.spin.rate_hz:.4f} +- {e.rate_std_hz:.4f} | {slope} | {off:.2f} |"
            print(f"| {kind} | {label} | {e.status} | {', '.join(flags)} {found}", flush=True)
        counts[kind] = (len(CASES[kind]), doubted, named)
    print("\n| truth | scenes | not called ok | named |\n|---|---|---|---|")
    for kind, (total, doubted, named) in counts.items():
        print(f"| {kind} | {total} | {doubted} | {named} |")


if __name__ == "__main__":
    main()
