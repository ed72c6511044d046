"""What the annotation formats have in common: who is seen where."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synth.capture import Folder
from synth.cast import Member
from synth.plan import Frame, Plan
from synth.truth.boxes import corners, projected, visible
from synth.truth.derive import view_of

# Trees and lamps have ids for the truth's sake; detectors are trained on road users.
ROAD_USERS = ("car", "van", "bus", "truck", "bicycle", "motorcycle", "pedestrian")


@dataclass(frozen=True)
class Sighting:
    """A road user in a frame: left, top, width and height in pixels of what is seen of it; the share of its whole box
    in the picture that its seen box covers."""

    member: Member
    box: tuple[int, int, int, int]
    pixels: int
    shown: float
    cut: bool  # its box reaches the edge of the picture


def sightings(plan: Plan, folder: Folder) -> Iterator[tuple[Frame, NDArray[np.uint32], list[Sighting]]]:
    """For every frame its ids [H, W] and who is seen, in the order of the ids."""
    members = plan.cast.members()
    size = np.array([member.dimensions_m for member in members]).reshape(-1, 3)
    for frame in plan.frames:
        view = view_of(plan, frame)
        ids = folder.read_truth(frame)["instance_id"]
        counts, seen = visible(ids, view.instance_id)
        _, whole = projected(view, corners(view.object_to_world, size))
        found = []
        for member, count, (left, top, right, bottom), box in zip(members, counts, seen, whole, strict=True):
            if count == 0 or member.class_name not in ROAD_USERS:
                continue
            area = (box[2] - box[0]) * (box[3] - box[1])
            shown = float(min(1.0, (right - left) * (bottom - top) / area)) if area > 0 else 1.0
            cut = left == 0 or top == 0 or right == view.size[0] or bottom == view.size[1]
            found.append(
                Sighting(member, (int(left), int(top), int(right - left), int(bottom - top)), int(count), shown, cut)
            )
        yield frame, ids, found
