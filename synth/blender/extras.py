"""Instances that effects add to the vehicles, as Blender objects."""

from dataclasses import dataclass
from typing import Any

import bpy
from mathutils import Matrix

from synth.blender.build import mesh_data
from synth.blender.materials import INSTANCE
from synth.plan import Plan
from synth.staging import Extras


@dataclass(frozen=True)
class Extra:
    """The objects of one effect, in the order of its instances."""

    objects: tuple[Any, ...]
    extras: Extras

    def place(self, time_s: float) -> None:
        """Bring them to an instant."""
        scales = self.extras.scales or (1.0,) * len(self.objects)
        for thing, pose, scale in zip(self.objects, self.extras.object_to_world(time_s), scales, strict=True):
            thing.matrix_world = Matrix(pose.tolist()) @ Matrix.Diagonal((scale, scale, scale, 1.0))
        if self.extras.present is not None:
            for thing, here in zip(self.objects, self.extras.present(time_s), strict=True):
                if thing.hide_render == bool(here):
                    thing.hide_render = not here
        if self.extras.lit is not None:
            for thing, shines in zip(self.objects, self.extras.lit(time_s), strict=True):
                thing.color = (*thing.color[:3], float(shines))  # see synth/glow.py


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
        built.append(Extra(tuple(objects), extras))
    return tuple(built)
