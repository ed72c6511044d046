"""What moves while the shutter is open, as keyframes at the times at which Cycles looks.

Cycles takes the pose of an object with n motion steps at 2^n + 1 evenly spaced times of the shutter and joins them by
straight lines; a key stands at each of these times, so that Blender's own interpolation never matters. The middle one
is the frame's instant: the truth, which renders without blur, sees exactly that.
"""

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np

from synth.blender.build import Stage
from synth.blender.extras import Extra
from synth.camera import OPENCV_TO_OPENGL, quaternion, same_hemisphere
from synth.plan import Frame, Plan


def animate(plan: Plan, frame: Frame, stage: Stage, extras: Sequence[Extra]) -> None:
    """Key the camera and everything that moves around the frame's instant, which is Blender's current frame."""
    shutter, fps = plan.shutter, plan.scene.time.fps
    count = 2**shutter.steps + 1
    offsets_s = np.linspace(-0.5, 0.5, count) * (shutter.exposure_s + shutter.readout_s)
    times = frame.time_s + offsets_s
    keys = stage.scene.frame_current + offsets_s * fps
    bpy.context.preferences.edit.keyframe_new_interpolation_type = "LINEAR"
    camera = np.stack([plan.flight.camera_to_world(float(t)) @ OPENCV_TO_OPENGL for t in times])
    members = np.stack([plan.cast.object_to_world(float(t)) for t in times])  # [T, M, 4, 4]
    for thing, poses in zip(_movers(stage, extras), [camera, *np.swapaxes(members, 0, 1)], strict=True):
        thing.cycles.motion_steps = shutter.steps
        if not (poses == poses[0]).all():
            _key(thing, poses, keys)


def stand_still(stage: Stage, extras: Sequence[Extra]) -> None:
    """Forget the keys, which would overrule where things are placed."""
    for thing in _movers(stage, extras):
        thing.animation_data_clear()


def _movers(stage: Stage, extras: Sequence[Extra]) -> list[Any]:
    """The camera, then the members of the cast in their order."""
    return [stage.camera, *stage.vehicles, *(thing for extra in extras for thing in extra.objects)]


def _key(thing: Any, poses: np.ndarray, keys: np.ndarray) -> None:
    thing.rotation_mode = "QUATERNION"
    rotations = same_hemisphere(np.stack([quaternion(pose[:3, :3]) for pose in poses]))
    for pose, rotation, key in zip(poses, rotations, keys, strict=True):
        thing.location, thing.rotation_quaternion = pose[:3, 3].tolist(), rotation.tolist()
        thing.keyframe_insert("location", frame=float(key))
        thing.keyframe_insert("rotation_quaternion", frame=float(key))
