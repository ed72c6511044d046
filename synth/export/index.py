"""capture.json and truth/tracks.npz."""

from typing import Any

import numpy as np

from synth.capture import Folder
from synth.plan import Plan
from synth.traffic.fleet import BODIES


def tracks(plan: Plan) -> dict[str, np.ndarray]:
    """The arrays of truth/tracks.npz."""
    times = [frame.time_s for frame in plan.frames]
    return {
        "instance_id": np.array([instance.id for instance in plan.fleet.instances], dtype=np.uint32),
        "time_s": np.array(times),
        "object_to_world": np.stack([plan.fleet.object_to_world(time) for time in times]),
        "speed_mps": np.stack([plan.fleet.speed_mps(time) for time in times]),
        "moving": np.stack([plan.fleet.moving(time) for time in times]),
    }


def index(plan: Plan, folder: Folder, generator: dict[str, Any]) -> dict[str, Any]:
    """The content of capture.json."""
    camera = plan.scene.camera
    return {
        "format": "aa4d-capture",
        "version": 1,
        "name": plan.scene.name,
        "generator": generator,
        "fps": plan.scene.time.fps,
        "camera": {"model": "PINHOLE", "width": camera.width_px, "height": camera.height_px, "K": plan.K.tolist()},
        "points": "points.ply",
        "tracks": "truth/tracks.npz",
        "frames": [
            {
                "name": frame.name,
                "image": folder.relative(folder.image(frame)),
                "truth": folder.relative(folder.truth(frame)),
                "time_s": frame.time_s,
                "t": frame.t,
                "split": frame.split,
                "viewmat": frame.viewmat.tolist(),
            }
            for frame in plan.frames
        ],
        "instances": [
            {
                "id": instance.id,
                "name": instance.name,
                "class": BODIES[instance.kind].label,
                "dimensions_m": list(BODIES[instance.kind].dimensions_m),
            }
            for instance in plan.fleet.instances
        ],
    }
