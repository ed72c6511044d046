"""What an effect of the stage "scene" brings: a change of the city, more instances, things built into Blender.

The effects themselves never import bpy: they are handed Blender's objects.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synth.city.layout import City
from synth.city.mesh import Mesh

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Extras:
    """Instances besides the vehicles. Functions of the time in seconds return arrays over the K extras."""

    names: tuple[str, ...]
    classes: tuple[str, ...]
    dimensions_m: Array  # [K, 3]
    meshes: tuple[Mesh, ...]  # K of them; equal ones may be one object
    object_to_world: Callable[[float], Array]  # [K, 4, 4] rigid
    speed_mps: Callable[[float], Array]  # [K] of their fastest point
    lit: Callable[[float], NDArray[np.bool_]] | None = None  # [K] shining; None: none of them shines
    present: Callable[[float], NDArray[np.bool_]] | None = None  # [K] in the scene; None: always
    scales: tuple[float, ...] | None = None  # of the meshes; None: all 1


class Staging:
    """One effect at work on one plan; as it stands it changes nothing."""

    def city(self, city: City) -> City:
        """The city without what the effect takes over."""
        return city

    def extras(self) -> Extras | None:
        """Instances that the effect adds."""
        return None

    def build(self, stage: Any) -> None:
        """Change what Blender has built; `stage.data` is bpy.data."""

    def place(self, time_s: float) -> None:
        """Bring what `build` made to an instant."""

    def brightness(self, points: Array, time_s: float) -> Array | None:  # noqa: ARG002
        """Relative light [...] at world points [..., 3], where the effect changes it over time without motion."""
        return None
