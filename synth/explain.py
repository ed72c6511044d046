"""What a scene would be rendered to, in words, before anything is."""

import numpy as np

from synth.effects import STAGES
from synth.plan import Plan
from synth.truth import ALWAYS

# Rough: seconds of one core for a million pixels, from the cost.json of captures of scenes/crossroads.toml.
PICTURE_S, SAMPLE_S, DENOISE_S, TRUTH_S = 10.0, 4.0, 15.0, 5.0


def explain(plan: Plan) -> str:
    """Frames, cameras, effects by their stages, passes, and a rough number of seconds."""
    scene, camera = plan.scene, plan.scene.camera
    poses = np.stack([plan.flight.camera_to_world(frame.time_s) for frame in plan.frames])
    flown = float(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum())
    moving = np.stack([plan.cast.moving(frame.time_s) for frame in plan.frames])
    land = ["  ground   with land to the horizon, because a frame looks beyond the scene's own"]
    lines = [
        f"{scene.name}: {len(plan.frames)} frames of {camera.width_px}x{camera.height_px} at {scene.time.fps:g} fps",
        f"  flight   {scene.flight.kind}, {flown:.1f} m from z {poses[0, 2, 3]:.1f} m to {poses[-1, 2, 3]:.1f} m",
        *(land if plan.city.land.faces else []),
        f"  traffic  {moving.shape[1]} instances, {int(moving.any(axis=0).sum())} of them move",
        *(f"           {note}" for note in plan.fleet.notes),
        f"  render   {scene.render.samples} samples, {'denoised' if scene.render.denoise else 'not denoised'}",
        f"  truth    {', '.join(dict.fromkeys((*ALWAYS, *scene.truth.passes)))}",
        "  effects  " + (", ".join(effect.name for effect in plan.effects) or "none"),
    ]
    for stage in STAGES:
        for effect in (e for e in plan.effects if e.stage == stage):
            settings = ", ".join(f"{name} {value}" for name, value in vars(effect.settings).items())
            lines.append(f"    {stage:8} {effect.name}: {settings}; costs {effect.module.COST}")
    lines.append(f"  about {_duration(_seconds(plan))} on one core, rough to a factor of two")
    return "\n".join(lines)


def _seconds(plan: Plan) -> float:
    camera, render = plan.scene.camera, plan.scene.render
    across, down = plan.lens.margin_px
    million = (camera.width_px + 2 * across) * (camera.height_px + 2 * down) / 1e6
    picture = PICTURE_S + SAMPLE_S * render.samples + DENOISE_S * render.denoise
    return len(plan.frames) * million * (picture + TRUTH_S)


def _duration(seconds: float) -> str:
    return (
        f"{seconds:.0f} s"
        if seconds < 120
        else f"{seconds / 60:.0f} min"
        if seconds < 7200
        else f"{seconds / 3600:.1f} h"
    )
