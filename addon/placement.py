"""What a person did to the points themselves, kept through playback: Apply Rotation, Apply Scale, Set Origin, or all of
them moved in edit mode. The map from the model's metres to the mesh's is found again and remembered on the mesh.
"""

import zlib

import bpy
import numpy as np
from mathutils import Matrix

from . import affine, names, points
from .container import Floats
from .model import Doubles
from .source import Source

(POSITION_KEY,) = names.keys_of((names.POSITION,))
FIRST_KEY = names.key_name(POSITION_KEY, 0)


def map_of(mesh: bpy.types.Mesh) -> Doubles | None:
    """The map [4, 4] from world metres as the model has them to the mesh's, or None where they are the same."""
    kept = mesh.get(names.MAP_PROPERTY)
    return None if kept is None else np.array(kept, np.float64).reshape(4, 4)


def from_mesh(mesh: bpy.types.Mesh, place: Doubles) -> Doubles:
    """A place [3] in the mesh's metres, in the model's."""
    matrix = map_of(mesh)
    return place if matrix is None else np.linalg.solve(matrix, np.append(place, 1.0))[:3]


def remember(mesh: bpy.types.Mesh, t: float) -> None:
    """Note that the mesh now shows its points as they are at t."""
    mesh[names.PLACED_PROPERTY] = f"{float(t)!r} {_sum(points.read(mesh, names.POSITION.name))}"


def forget(mesh: bpy.types.Mesh) -> None:
    """Do not compare the points with the model: from now on it is another one."""
    mesh.pop(names.PLACED_PROPERTY, None)


def follow_live(obj: bpy.types.Object, source: Source, rows: slice | np.ndarray) -> bool:
    """Before the points of a live object are overwritten: remember where a person has moved all of them since.

    Whether some were moved in a way that is no map, and so cannot be kept.
    """
    mesh = obj.data
    kept = mesh.get(names.PLACED_PROPERTY)
    if kept is None:
        return False
    t, known = kept.split()
    now = points.read(mesh, names.POSITION.name)
    if not len(now) or _sum(now) == known:
        return False
    # Something is different, if only that points were deleted: this is rare, so it may cost an evaluation.
    raw = source.positions(obj.aa4d.carrier, float(t))[rows]
    matrix = map_of(mesh)
    if affine.same_places(raw if matrix is None else affine.moved_places(raw, matrix), now):
        return False
    return not _keep(mesh, affine.fit(raw, now))


def has_keys(mesh: bpy.types.Mesh) -> bool:
    """Whether the mesh is one of `show_first_key`."""
    return FIRST_KEY in mesh.attributes and names.PLACED_PROPERTY in mesh


def follow_baked(mesh: bpy.types.Mesh) -> None:
    """Bring the keys of a baked mesh (`has_keys`) to where a person has moved its points; needs no model."""
    t, known = mesh[names.PLACED_PROPERTY].split()
    now = points.read(mesh, names.POSITION.name)
    if not len(now) or _sum(now) == known:
        return
    key = points.read(mesh, FIRST_KEY)
    if not affine.same_places(key, now):
        matrix, before = affine.fit(key, now), map_of(mesh)
        if matrix is not None:
            _keep(mesh, matrix if before is None else matrix @ before)
            _move_keys(mesh, matrix)
    show_first_key(mesh, float(t))


def show_first_key(mesh: bpy.types.Mesh, t: float) -> None:
    """Set the mesh itself, below its modifiers, to its first key, which is of time t: `follow_baked` compares them."""
    points.write(mesh, names.POSITION.name, names.POSITION.type, points.read(mesh, FIRST_KEY))
    remember(mesh, t)
    mesh.update()


def _move_keys(mesh: bpy.types.Mesh, matrix: Doubles) -> None:
    number = 0
    while names.key_name(POSITION_KEY, number) in mesh.attributes:
        held = {
            key.attribute: (name, key.type)
            for key in names.keys_of((names.POSITION, names.RADIUS, *names.SHAPE))
            if (name := names.key_name(key, number)) in mesh.attributes
        }
        values = affine.moved({attribute: points.read(mesh, name) for attribute, (name, _) in held.items()}, matrix)
        for attribute, (name, kind) in held.items():
            points.write(mesh, name, kind, values[attribute])
        number += 1


def _keep(mesh: bpy.types.Mesh, matrix: Doubles | None) -> bool:
    """Remember the map, where there is one; whether there is.

    Blender keeps children where they are by a new parent inverse and new transforms, which animation then takes back:
    the handles, whose keys are in the model's metres, get the parent inverse that suits their keys.
    """
    if matrix is None:
        return False
    mesh[names.MAP_PROPERTY] = matrix.ravel().tolist()
    for obj in bpy.data.objects:
        for child in obj.children if obj.data == mesh else ():
            if names.GROUP.name in child:
                child.matrix_parent_inverse = Matrix(matrix.tolist())
    return True


def _sum(places: Floats) -> str:
    return str(zlib.crc32(np.ascontiguousarray(places).data))
