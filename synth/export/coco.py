"""coco.json: boxes and masks (run-length encoded, uncompressed) of every frame, and the track of each annotation.

Format: https://cocodataset.org/#format-data.
"""

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.capture import Folder
from synth.export.annotations import ROAD_USERS, sightings
from synth.plan import Plan


def files(plan: Plan, folder: Folder) -> dict[str, str]:
    """Texts by path inside the capture."""
    camera = plan.scene.camera
    annotations: list[dict[str, Any]] = []
    images = []
    for frame, ids, seen in sightings(plan, folder):
        images.append({"id": frame.rank + 1, "file_name": folder.relative(folder.image(frame)),
                       "width": camera.width_px, "height": camera.height_px})  # fmt: skip
        for one in seen:
            annotations.append({
                "id": len(annotations) + 1, "image_id": frame.rank + 1, "track_id": one.member.id,
                "category_id": ROAD_USERS.index(one.member.class_name) + 1, "bbox": list(one.box),
                "area": one.pixels, "iscrowd": 0, "segmentation": run_lengths(ids == one.member.id),
            })  # fmt: skip
    categories = [{"id": number, "name": name} for number, name in enumerate(ROAD_USERS, start=1)]
    content = {"info": {"description": plan.scene.name}, "images": images, "annotations": annotations,
               "categories": categories}  # fmt: skip
    return {"coco.json": json.dumps(content) + "\n"}


def run_lengths(mask: NDArray[np.bool_]) -> dict[str, list[int]]:
    """COCO's run-length encoding: columns first, beginning with the length of the first run of zeros."""
    flat = np.concatenate([[False], mask.ravel(order="F"), [False]])
    edges = np.flatnonzero(flat[1:] != flat[:-1])
    counts = np.diff(np.concatenate([[0], edges, [mask.size]]))
    if len(counts) > 1 and counts[-1] == 0:
        counts = counts[:-1]
    return {"size": list(mask.shape), "counts": counts.tolist()}
