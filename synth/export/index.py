"""capture.json and truth/tracks.npz."""

import dataclasses
from typing import Any

import numpy as np

from synth.capture import Folder
from synth.effects import at
from synth.plan import Plan
from synth.truth.activity import LABELS
from synth.truth.classes import CLASSES


def tracks(plan: Plan) -> dict[str, np.ndarray]:
    """The arrays of truth/tracks.npz."""
    times = [frame.time_s for frame in plan.frames]
    return {
        "instance_id": np.array([member.id for member in plan.cast.members()], dtype=np.uint32),
        "time_s": np.array(times),
        "object_to_world": np.stack([plan.cast.object_to_world(time) for time in times]),
        "speed_mps": np.stack([plan.cast.speed_mps(time) for time in times]),
        "moving": np.stack([plan.cast.moving(time) for time in times]),
        "present": np.stack([plan.cast.present(time) for time in times]),
    }


def rows(plan: Plan) -> dict[str, np.ndarray]:
    """The arrays of truth/rows.npz: when each row was exposed, in the middle, and the pose of the camera then."""
    offsets = plan.shutter.row_offsets_s(plan.scene.camera.height_px)
    times = np.array([frame.time_s for frame in plan.frames])[:, None] + offsets
    poses = np.stack([[plan.flight.viewmat(float(time)) for time in frame] for frame in times])
    return {"row_time_s": times, "row_viewmat": poses}


def measured_viewmats(plan: Plan) -> np.ndarray | None:
    """What the capture gives as poses [N, 4, 4] where they are not the true ones."""
    found = None
    for effect in at(plan.effects, "capture"):  # each measures what the one before it gave
        found = effect.module.measure(effect.settings, plan)
        frames = tuple(dataclasses.replace(f, viewmat=found[f.rank]) for f in plan.frames)
        plan = dataclasses.replace(plan, frames=frames)
    return found


def index(plan: Plan, folder: Folder, generator: dict[str, Any], passes: dict[str, Any]) -> dict[str, Any]:
    """The content of capture.json; `passes` is what `truth.derive` says."""
    camera, asked = plan.scene.camera, plan.scene.truth.passes
    measured = measured_viewmats(plan)
    found = {
        "format": "aa4d-capture",
        "version": 1,
        "name": plan.scene.name,
        "generator": generator,
        "fps": plan.scene.time.fps,
        "camera": {**plan.lens.document(), "width": camera.width_px, "height": camera.height_px},
        "points": "points.ply",
        "tracks": "truth/tracks.npz",
        "checksums": "checksums.json",
        "frames": [
            {
                "name": frame.name,
                "image": folder.relative(folder.image(frame)),
                "truth": folder.relative(folder.truth(frame)),
                **{
                    name: folder.relative(folder.truth_pass(name, frame))
                    for name in ("flow", "occlusion", "activity")
                    if name in asked
                },
                "time_s": frame.time_s,
                "t": frame.t,
                "split": frame.split,
                "viewmat": (frame.viewmat if measured is None else measured[frame.rank]).tolist(),
                **({} if measured is None else {"viewmat_true": frame.viewmat.tolist()}),
            }
            for frame in plan.frames
        ],
        "instances": [
            {
                "id": member.id,
                "name": member.name,
                "class": member.class_name,
                "dimensions_m": list(member.dimensions_m),
            }
            for member in plan.cast.members()
        ],
        **passes,
    }
    if plan.effects:
        found["effects"] = [effect.name for effect in plan.effects]
    if not plan.shutter.instant:
        found["shutter"] = {"exposure_s": plan.shutter.exposure_s, "readout_s": plan.shutter.readout_s}
    if plan.shutter.readout_s > 0:
        found["rows"] = "truth/rows.npz"
    if "class_id" in asked:
        found["classes"] = list(CLASSES)
    if "activity" in asked:
        found["activity_labels"] = list(LABELS)
    return found
