"""Imports a model of the user's own as one mesh that fits the box of the kind it stands for."""

import math
from typing import Any

import bmesh
import bpy
from mathutils import Matrix, Vector

from synth.blender.materials import carry_instance
from synth.blender.session import unsaid
from synth.errors import InputError
from synth.models import Model
from synth.traffic.fleet import BODIES

ASKEW = 1.2  # times as wide as long: no vehicle is


def import_model(model: Model) -> Any:
    """The mesh: feet on the ground, centred, +x forward, its own materials.

    Raises:
        InputError: Blender cannot read the file, finds no faces in it, or it does not look along +x.
    """
    before = set(bpy.data.objects)
    try:
        with unsaid():
            _importer(model.path.suffix.lower())(filepath=str(model.path))
    except RuntimeError as error:
        reason = (str(error).strip().splitlines() or ["for an unknown reason"])[-1].removeprefix("Error: ")
        raise InputError(f"{model.path}: Blender cannot import it: {reason.rstrip('.')}.") from None
    bpy.context.view_layer.update()
    found = [thing for thing in bpy.data.objects if thing not in before]
    joined = bmesh.new()
    materials: list[Any] = []
    for thing in found:
        if thing.type != "MESH":
            continue
        part = thing.data.copy()
        part.transform(thing.matrix_world)
        for polygon in part.polygons:
            polygon.material_index += len(materials)
        materials += list(part.materials) or [None]
        joined.from_mesh(part)
        bpy.data.meshes.remove(part)
    for thing in found:
        bpy.data.objects.remove(thing)
    if not joined.faces:
        raise InputError(f"{model.path}: holds no faces; export the model with its meshes.")
    mesh = bpy.data.meshes.new(f"{model.kind}-model")
    joined.to_mesh(mesh)
    joined.free()
    for material in materials:
        mesh.materials.append(carry_instance(material, f"{model.kind}-plain"))
    _fit(mesh, model)
    return mesh


def _importer(suffix: str) -> Any:
    if suffix in (".glb", ".gltf"):
        return bpy.ops.import_scene.gltf
    return bpy.ops.wm.obj_import if suffix == ".obj" else bpy.ops.import_scene.fbx


def _fit(mesh: Any, model: Model) -> None:
    """Turn, scale evenly into the kind's box and stand on the ground: the boxes of the truth then hold.

    Raises:
        InputError: a vehicle that is clearly wider than long.
    """
    mesh.transform(Matrix.Rotation(math.radians(model.yaw_deg), 4, "Z"))
    low = Vector(tuple(min(v.co[axis] for v in mesh.vertices) for axis in range(3)))
    high = Vector(tuple(max(v.co[axis] for v in mesh.vertices) for axis in range(3)))
    size = high - low
    box = BODIES[model.kind].dimensions_m
    if box[0] > box[1] and size.y > ASKEW * size.x:
        times = size.y / max(size.x, 1e-9)
        raise InputError(
            f"{model.path}: with yaw_deg = {model.yaw_deg:g} the model is {times:.1f} times as wide as long; turn it "
            "by 90 degrees more or less, so that it looks along +x."
        )
    scale = min(box[axis] / size[axis] for axis in range(3) if size[axis] > 1e-9)
    foot = Vector(((low.x + high.x) / 2, (low.y + high.y) / 2, low.z))
    mesh.transform(Matrix.Scale(scale, 4) @ Matrix.Translation(-foot))
    mesh.update()
