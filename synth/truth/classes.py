"""What kind of thing a pixel shows: surfaces of the city by their material, instances by their class."""

import numpy as np
from numpy.typing import NDArray

CLASSES = (
    "nothing", "other", "road", "pavement", "vegetation", "building", "furniture",
    "car", "van", "bus", "truck", "bicycle", "motorcycle", "pedestrian", "tree", "signal-lamp", "indicator",
)  # fmt: skip

_GROUPS = {
    "road": ("asphalt", "patch", "worn", "tar", "cycle-lane", "iron", "marking"),
    "pavement": ("kerb", "pavement", "court", "gravel", "yard", "paving", "concrete"),
    "vegetation": ("grass", "land", "bark", "leaves", "flowers"),
    "building": ("wall", "trim", "window", "shop", "flat-roof", "tiles", "awning", "cladding", "far-wall"),
    "furniture": ("metal", "lamp", "wood"),
}
CLASS_OF_SURFACE = {surface: name for name, surfaces in _GROUPS.items() for surface in surfaces}


def class_number(name: str) -> int:
    """Index in `CLASSES`; what is not listed is "other"."""
    return CLASSES.index(name if name in CLASSES else "other")


def class_id(
    surface_class: NDArray[np.uint8], instance_id: NDArray[np.uint32], classes: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    """Classes [H, W] from those of the surfaces [H, W], overruled where an instance is; `classes` [M + 1] is by id."""
    return np.where(instance_id > 0, classes[np.minimum(instance_id, len(classes) - 1)], surface_class)
