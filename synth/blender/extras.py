"""Instances that effects add to the vehicles, as Blender objects."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from synth.blender.build import mesh_data
from synth.blender.materials import INSTANCE
from synth.plan import Plan


@dataclass(frozen=True)
class Extra:
    """The objects of one effect, in the order of its instances."""

    objects: tuple[Any, ...]
    object_to_world: Callable[[float], NDArray[np.float64]]
    lit: Callable[[float], NDArray[np.bool_]] | None

    def place(self, time_s: float) -> None:
        for thing, pose in zip(self.objects, self.object_to_world(time_s), strict=True):
            thing.matrix_world = Matrix(pose.tolist())
        if self.lit is not None:
            for thing, shines in zip(self.objects, self.lit(time_s), strict=True):
                thing.color = (*thing.color[:3], float(shines))  # read by the material of the surface "glow"


def build_extras(plan: Plan, scene: Any) -> tuple[Extra, ...]:
    """Objects for all extras of a plan; equal meshes are shared."""
    built, number = [], len(plan.fleet.instances)
    for extras in plan.cast.extras:
        meshes: dict[int, Any] = {}
        objects = []
        for name, mesh in zip(extras.names, extras.meshes, strict=True):
            number += 1
            if id(mesh) not in meshes:
                meshes[id(mesh)] = mesh_data(name, mesh)
            thing = bpy.data.objects.new(name, meshes[id(mesh)])
            thing[INSTANCE] = float(number)
            scene.collection.objects.link(thing)
            objects.append(thing)
        built.append(Extra(tuple(objects), extras.object_to_world, extras.lit))
    return tuple(built)
