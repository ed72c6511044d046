"""The look of every surface, by name: what the meshes refer to and what Blender's materials are made from."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Surface:
    """Linear RGB, roughness, and slow variation of the colour: (features per metre, relative strength) each.

    `slabs_m` draws joints of that spacing on horizontal faces, `windows_m` rows of dark windows on walls.
    `paint` takes the colour of the object instead.
    """

    colour: tuple[float, float, float]
    roughness: float = 0.9
    metallic: float = 0.0
    variation: tuple[tuple[float, float], ...] = ()
    slabs_m: float = 0.0
    windows_m: float = 0.0
    paint: Literal["face", "object"] = "face"


GROUND = ((0.12, 0.25), (0.9, 0.22))

SURFACES = {
    "asphalt": Surface((0.075, 0.076, 0.080), 0.95, variation=((0.10, 0.30), (0.6, 0.22), (3.0, 0.18))),
    "patch": Surface((0.045, 0.046, 0.050), 0.95, variation=((0.8, 0.2), (4.0, 0.15))),
    "worn": Surface((0.060, 0.060, 0.063), 0.85, variation=((0.10, 0.30), (0.5, 0.3), (3.0, 0.2))),
    "tar": Surface((0.025, 0.025, 0.027), 0.5, variation=((1.5, 0.3),)),
    "cycle-lane": Surface((0.22, 0.062, 0.045), 0.95, variation=((0.3, 0.25), (2.5, 0.2))),
    "concrete": Surface((0.34, 0.33, 0.31), 0.9, variation=((0.12, 0.25), (0.7, 0.15), (3.0, 0.12))),
    "yard": Surface((0.17, 0.165, 0.155), 0.95, variation=((0.08, 0.35), (0.6, 0.2), (3.0, 0.15)), slabs_m=4.0),
    "paving": Surface((0.31, 0.28, 0.25), 0.9, variation=((0.12, 0.2), (0.9, 0.15)), slabs_m=0.8),
    "flowers": Surface((0.30, 0.05, 0.09), 1.0, variation=((1.5, 0.6), (5.0, 0.6))),
    "water": Surface((0.03, 0.07, 0.08), 0.08),
    "wood": Surface((0.16, 0.09, 0.045), 0.8, variation=((3.0, 0.3),)),
    "cladding": Surface((1.0, 1.0, 1.0), 0.5, metallic=0.2, variation=((0.2, 0.15), (1.0, 0.08))),
    "far-wall": Surface((1.0, 1.0, 1.0), 0.9, variation=((0.12, 0.2),), windows_m=3.2),
    "bus-roof": Surface((0.55, 0.55, 0.53), 0.7),
    "truck-box": Surface((0.60, 0.60, 0.58), 0.6),
    "skin": Surface((0.36, 0.20, 0.13), 0.7),
    "cloth": Surface((0.03, 0.035, 0.05), 0.9),
    "iron": Surface((0.035, 0.033, 0.032), 0.6, metallic=0.3),
    "marking": Surface((0.62, 0.62, 0.60), 0.8, variation=((1.2, 0.25), (6.0, 0.2))),
    "kerb": Surface((0.36, 0.35, 0.33), 0.9, variation=((1.0, 0.2),)),
    "pavement": Surface((0.27, 0.255, 0.235), 0.9, variation=GROUND, slabs_m=1.0),
    "court": Surface((0.20, 0.175, 0.15), 0.95, variation=GROUND),
    "grass": Surface((0.075, 0.125, 0.035), 1.0, variation=((0.15, 0.35), (0.8, 0.35), (3.0, 0.25))),
    "land": Surface((0.080, 0.120, 0.040), 1.0, variation=((0.002, 0.35), (0.011, 0.3), (0.15, 0.25))),
    "gravel": Surface((0.30, 0.26, 0.20), 1.0, variation=GROUND),
    "wall": Surface((1.0, 1.0, 1.0), 0.9, variation=((0.25, 0.14), (1.5, 0.10))),
    "trim": Surface((0.55, 0.54, 0.51), 0.8, variation=((0.8, 0.1),)),
    "window": Surface((0.035, 0.045, 0.06), 0.12),
    "shop": Surface((0.03, 0.035, 0.04), 0.15),
    "flat-roof": Surface((0.20, 0.20, 0.20), 0.95, variation=((0.15, 0.3), (1.0, 0.25))),
    "tiles": Surface((0.30, 0.10, 0.055), 0.9, variation=((0.3, 0.2), (2.0, 0.25))),
    "metal": Surface((0.35, 0.36, 0.37), 0.5, metallic=0.6),
    "awning": Surface((1.0, 1.0, 1.0), 0.9),
    "bark": Surface((0.07, 0.05, 0.035), 1.0),
    "leaves": Surface((0.06, 0.115, 0.028), 0.9, variation=((0.7, 0.35), (2.5, 0.45))),
    "lamp": Surface((0.9, 0.9, 0.85), 0.4),
    "paint": Surface((1.0, 1.0, 1.0), 0.35, paint="object"),
    "glass": Surface((0.012, 0.016, 0.02), 0.08),
    "tyre": Surface((0.012, 0.012, 0.012), 0.9),
    "hub": Surface((0.35, 0.35, 0.36), 0.4, metallic=0.8),
    "bumper": Surface((0.03, 0.03, 0.03), 0.8),
    "head-light": Surface((0.85, 0.85, 0.80), 0.2),
    "tail-light": Surface((0.40, 0.01, 0.01), 0.3),
    "plate": Surface((0.7, 0.7, 0.65), 0.6),
}
