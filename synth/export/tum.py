"""poses.tum: the camera's trajectory, one line a frame: time, position, quaternion x y z w (camera to world).

Format: https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats.
"""

import numpy as np

from synth.camera import invert_rigid, quaternion, same_hemisphere
from synth.capture import Folder
from synth.plan import Plan


def files(plan: Plan, folder: Folder) -> dict[str, str]:  # noqa: ARG001
    """Texts by path inside the capture."""
    poses = np.stack([invert_rigid(frame.viewmat) for frame in plan.frames])
    turned = same_hemisphere(np.stack([quaternion(pose[:3, :3]) for pose in poses]))
    lines = ["# timestamp tx ty tz qx qy qz qw"]
    for frame, pose, (w, x, y, z) in zip(plan.frames, poses, turned, strict=True):
        lines.append(" ".join(repr(float(value)) for value in (frame.time_s, *pose[:3, 3], x, y, z, w)))
    return {"poses.tum": "\n".join(lines) + "\n"}
