"""transforms.json: the cameras in nerfstudio's convention (OpenGL axes, camera to world)."""

from typing import Any

import numpy as np

from synth.camera import OPENCV_TO_OPENGL, invert_rigid
from synth.plan import Plan


def transforms(plan: Plan) -> dict[str, Any]:
    """The file's content; `time` is t in [0, 1]."""
    camera, K = plan.scene.camera, plan.K
    frames = [
        {
            "file_path": f"frames/{frame.name}.png",
            "transform_matrix": (invert_rigid(frame.viewmat) @ OPENCV_TO_OPENGL).tolist(),
            "time": frame.t,
        }
        for frame in plan.frames
    ]
    names = {split: [f"frames/{f.name}.png" for f in plan.frames if f.split == split] for split in ("train", "test")}
    return {
        "camera_model": "OPENCV",
        "w": camera.width_px, "h": camera.height_px,
        "fl_x": K[0, 0], "fl_y": K[1, 1], "cx": K[0, 2], "cy": K[1, 2],
        "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0, **plan.lens.document().get("distortion", {}),
        "ply_file_path": "points.ply",
        "applied_transform": np.eye(4)[:3].tolist(),
        "train_filenames": names["train"], "val_filenames": names["test"], "test_filenames": names["test"],
        "frames": frames,
    }  # fmt: skip
