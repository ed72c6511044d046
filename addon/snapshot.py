"""What an imported object shows at the scene's frame, live or baked, as arrays: for exports and statistics."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
import numpy.typing as npt

from . import groups, look_nodes, modifiers, names, points
from .container import Floats


@dataclass(frozen=True)
class Snapshot:
    """The points at one time. World metres where the object was not moved."""

    ids: npt.NDArray[np.int32]  # [n]
    positions: Floats  # [n, 3]
    colors: Floats  # [n, 4] linear
    opacity: Floats  # [n]
    radius: Floats  # [n]
    scales: Floats  # [n, 3]
    rotations: Floats  # [n, 4]
    seen: npt.NDArray[np.bool_]  # [n] opaque enough for its object's look to draw it


@contextmanager
def without_look(obj: bpy.types.Object) -> Iterator[None]:
    """Switch the look off for a while: what is left of the object are its points and their attributes."""
    look = modifiers.of(obj, names.LOOK_MODIFIER)
    if look is None:
        yield
        return
    shown, look.show_viewport = look.show_viewport, False
    try:
        yield
    finally:
        look.show_viewport = shown


def take(objects: Sequence[bpy.types.Object], depsgraph: bpy.types.Depsgraph) -> Snapshot:
    """The points of these objects now, in the metres of the first; their looks must be off, see `without_look`."""
    depsgraph.update()
    taken = [_take(obj, objects[0], depsgraph) for obj in objects]
    return Snapshot(*(np.concatenate(columns) for columns in zip(*taken, strict=True)))


def _take(obj: bpy.types.Object, first: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[np.ndarray, ...]:
    """The fields of a snapshot of one object, as the first one's frame has them: a person may have moved it."""
    evaluated = obj.evaluated_get(depsgraph)
    data = evaluated.data
    ids = points.read(data, names.ID.name).astype(np.int32)
    values = {a: points.read(data, a.name) for a in (*names.APPEARANCE, *names.SHAPE)}
    if obj != first:
        beside = first.evaluated_get(depsgraph).matrix_world.inverted_safe() @ evaluated.matrix_world
        matrix, grown = np.array(beside, np.float32), beside.median_scale
        if not np.allclose(matrix, np.eye(4), atol=1e-6):
            values[names.POSITION] = values[names.POSITION] @ matrix[:3, :3].T + matrix[:3, 3]
            values[names.ROTATION] = groups.product(np.array(beside.to_quaternion()), values[names.ROTATION])
            values[names.SCALE], values[names.RADIUS] = grown * values[names.SCALE], grown * values[names.RADIUS]
    return (
        ids,
        values[names.POSITION],
        values[names.COLOR],
        values[names.OPACITY],
        values[names.RADIUS],
        values[names.SCALE],
        values[names.ROTATION],
        values[names.OPACITY] >= faintest(obj),
    )


def faintest(obj: bpy.types.Object) -> float:
    """The opacity below which the object's look draws nothing."""
    look = modifiers.of(obj, names.LOOK_MODIFIER)
    if look is None:
        return 0.0
    return float(modifiers.get(look, look_nodes.MINIMUM_OPACITY))


def statistics(mesh: bpy.types.Mesh, chosen: npt.NDArray[np.bool_]) -> list[str]:
    """What there is to say about some of the points, a line each."""
    if not chosen.any():
        return ["Nothing is selected"]
    xyz = points.read(mesh, names.POSITION.name)[chosen]
    opacity = points.read(mesh, names.OPACITY.name)[chosen]
    size = np.ptp(xyz, axis=0)
    lines = [
        f"{chosen.sum():,} of {len(chosen):,} points",
        "centre {:.2f}, {:.2f}, {:.2f} m".format(*xyz.mean(axis=0)),
        "size {:.2f} x {:.2f} x {:.2f} m".format(*size),
        f"opacity {opacity.mean():.2f} in the mean, {opacity.min():.2f} to {opacity.max():.2f}",
    ]
    for attribute, unit in ((names.DISPLACEMENT, "m"), (names.SPEED, "m/s")):
        if attribute.name in mesh.attributes:
            values = points.read(mesh, attribute.name)[chosen]
            word = attribute.name.removeprefix("aa_")
            lines.append(f"{word} {values.mean():.2f} {unit} in the mean, {values.max():.2f} at most")
    return lines
