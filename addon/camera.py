"""The capture's camera as an animated Blender camera with the same intrinsics and poses."""

import itertools
import json
import math
import re
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from . import names
from .clip import Clip
from .header import Doubles

LONGEST_NUMBER = 9  # digits of a frame's name that Blender can count in
SENSOR_MM = 36.0  # any width serves: the lens follows from it
OPENCV_TO_BLENDER = np.diag([1.0, -1.0, -1.0])  # Blender's camera looks along -z with y up


def create_camera(clip: Clip, reach: Doubles, name: str, stretch: float) -> bpy.types.Object:
    """A camera with a key a frame of the clip, `stretch` frames of the timeline for one of its clock: location and
    quaternion, linear between them. It sees as far as the scene, which reaches `reach` [3] metres from the origin along
    each axis."""
    data = bpy.data.cameras.new(name)
    camera, K = clip.camera, clip.camera.K
    data.sensor_fit, data.sensor_width = "HORIZONTAL", SENSOR_MM
    data.lens = K[0, 0] * SENSOR_MM / camera.width
    # Shifts are in units of the image's width as it is seen, which pixel_aspect makes equal on both axes.
    data.shift_x = (camera.width / 2 - K[0, 2]) / camera.width
    data.shift_y = (K[1, 2] - camera.height / 2) / camera.width * K[0, 0] / K[1, 1]
    farthest = reach + np.abs(clip.camera_centers).max(axis=0)
    data.clip_end = max(1000.0, 2.0 * float(np.linalg.norm(farthest)))
    obj = bpy.data.objects.new(name, data)
    obj.rotation_mode = "QUATERNION"
    rotations = clip.viewmats[:, :3, :3].transpose(0, 2, 1) @ OPENCV_TO_BLENDER
    quaternions = np.array([Matrix(rotation.tolist()).to_quaternion() for rotation in rotations])
    animate(obj, "location", clip.camera_centers, clip.ranks * stretch)
    animate(obj, "rotation_quaternion", in_one_hemisphere(quaternions), clip.ranks * stretch)
    return obj


def show_frames(camera: bpy.types.Object, clip: Clip, stretch: float) -> bool:
    """Set the capture's frames behind the camera, in step with the timeline; whether they were found.

    The path stands in the model file, so what it leads to must be a capture, and the frames must lie inside it,
    numbered one after the other.
    """
    first = _first_frame(clip)
    if first is None:
        return False
    path, number = first
    try:
        image = bpy.data.images.load(str(path))
    except (RuntimeError, ValueError):  # no picture, or a name that is not UTF-8
        return False
    count = len(clip.images)
    image.source = "SEQUENCE" if count > 1 else "FILE"
    background = camera.data.background_images.new()
    background.image, background.alpha, background.display_depth = image, 1.0, "BACK"
    user = background.image_user
    user.use_auto_refresh = True
    user.frame_start, user.frame_duration = names.FIRST_FRAME, count
    user.frame_offset = number - 1  # Blender takes the first file of a sequence for number 1
    if not clip.is_even:  # Blender shows a file a frame: the offset makes up for it
        at = np.arange(math.ceil(clip.ranks[-1] * stretch) + 1, dtype=np.float64)
        user.frame_duration = len(at)
        shown = np.searchsorted(clip.ranks, at / stretch + 1e-4, side="right") - 1
        offsets = (number - 1 + shown - at)[:, None]
        animate(camera.data, "background_images[0].image_user.frame_offset", offsets, at, "CONSTANT")
    elif stretch != 1:
        user.frame_duration = math.ceil((count - 1) * stretch) + 1
        driver = camera.data.driver_add("background_images[0].image_user.frame_offset").driver
        passed = f"min(max(frame - {names.FIRST_FRAME}, 0), {user.frame_duration - 1})"
        rank = f"min(floor({passed} / {stretch!r} + 1e-4), {count - 1})"
        driver.expression = f"{number - 1} + {rank} - {passed}"
    camera.data.show_background_images = True
    return True


def _first_frame(clip: Clip) -> tuple[Path, int] | None:
    """The capture's first frame and its number, where all are numbered one after the other and it is there."""
    folder = capture_folder(clip)
    if folder is None or not clip.images:
        return None
    numbered = [re.fullmatch(rf"(.*?)([0-9]{{1,{LONGEST_NUMBER}}})(\.\w+)", image) for image in clip.images]
    first = numbered[0]
    if first is None or not all(
        match is not None and match[1] == first[1] and match[3] == first[3] and int(match[2]) == int(first[2]) + rank
        for rank, match in enumerate(numbered)
    ):
        return None
    try:
        path = (folder / clip.images[0]).resolve()
        found = path.is_relative_to(folder) and path.is_file()
    except (OSError, ValueError):  # too long for a path, or with characters that none has
        return None
    return (path, int(first[2])) if found else None


def capture_folder(clip: Clip) -> Path | None:
    """The capture that the model was trained on, where it still lies beside it."""
    if clip.capture is None:
        return None
    try:
        folder = (clip.path.parent / clip.capture).resolve()
        index = json.loads((folder / "capture.json").read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return folder if isinstance(index, dict) and index.get("format") == "aa4d-capture" else None


def in_one_hemisphere(quaternions: Doubles) -> Doubles:
    """Quaternions [n, 4], each in the hemisphere of the one before, so that nothing turns the long way round."""
    for previous, quaternion in itertools.pairwise(quaternions):
        if previous @ quaternion < 0:
            quaternion *= -1
    return quaternions


def animate(owner: bpy.types.ID, path: str, values: Doubles, at: Doubles, interpolation: str = "LINEAR") -> None:
    """Key the property with a row of values [n, components] each; `at` [n] in frames from the timeline's first."""
    holder, _, name = path.rpartition(".")
    first = values[0].tolist()  # of one number: frames, which Blender takes as whole numbers only
    setattr(owner.path_resolve(holder) if holder else owner, name, first if len(first) > 1 else round(first[0]))
    owner.keyframe_insert(path, frame=names.FIRST_FRAME)  # makes the action and its slot as this Blender wants them
    animation = owner.animation_data  # an object and its data share an action, each with a slot
    curves = animation.action.layers[0].strips[0].channelbag(animation.action_slot).fcurves
    for index, column in enumerate(values.T):
        curve = curves.find(path, index=index)
        curve.keyframe_points.add(len(column) - 1)
        frames = at + names.FIRST_FRAME
        curve.keyframe_points.foreach_set("co", np.stack([frames, column], axis=1).astype(np.float32).ravel())
        for point in curve.keyframe_points:
            point.interpolation = interpolation
        curve.update()
