"""What an imported object shows at the scene's frame, live or baked, as arrays: for exports and statistics."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import numpy as np
import numpy.typing as npt

from . import affine, looks, materials, modifiers, names, parts, points
from .container import Floats
from .looks import node_groups


@dataclass(frozen=True)
class Snapshot:
    """The points at one time, in world metres, as they are drawn."""

    ids: npt.NDArray[np.int32]  # [n]
    positions: Floats  # [n, 3]
    colors: Floats  # [n, 4] linear
    opacity: Floats  # [n]
    radius: Floats  # [n]
    scales: Floats  # [n, 3]
    rotations: Floats  # [n, 4]
    seen: npt.NDArray[np.bool_]  # [n] what the filters and the crop of its object's look let through


@contextmanager
def stand_ins(objects: Sequence[bpy.types.Object], scene: bpy.types.Scene) -> Iterator[list[bpy.types.Object]]:
    """Copies of the objects, for a while, that are points and not what the look draws at them; the objects themselves
    are left alone."""
    copies = []
    try:
        for obj in objects:
            copy = obj.copy()
            copies.append(copy)
            scene.collection.objects.link(copy)
            copy.hide_viewport = False
            look = modifiers.of(copy, names.LOOK_MODIFIER)
            if look is None:
                continue
            look.show_viewport = True
            kept = modifiers.values_of(look)
            look.node_group = node_groups.shown_group()
            for name, value in modifiers.values_of(look).items():  # all survive the change, but for older groups
                if kept.get(name, value) != value:
                    modifiers.put(look, name, kept[name])
            if copy.aa4d.playback == "LIVE":
                modifiers.put(look, looks.LOOK, materials.GAUSSIANS)  # so that shapes are evaluated
        yield copies
    finally:
        for copy in copies:
            bpy.data.objects.remove(copy)


def take(objects: Sequence[bpy.types.Object], depsgraph: bpy.types.Depsgraph) -> Snapshot:
    """The points of these `stand_ins` now.

    Raises:
        OSError: a modifier of the person has made something else of them.
    """
    depsgraph.update()
    taken = [_take(obj, depsgraph) for obj in objects]
    return Snapshot(*(np.concatenate(columns) for columns in zip(*taken, strict=True)))


def _take(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> tuple[np.ndarray, ...]:
    """The fields of a snapshot of one object."""
    evaluated = obj.evaluated_get(depsgraph)
    data, needed = evaluated.data, (*names.APPEARANCE, *names.SHAPE, names.ID)
    missing = [attribute.name for attribute in needed if attribute.name not in data.attributes]
    if missing:
        raise OSError(f"{obj.name} has no {missing[0]} after its modifiers; switch off those that are not its own.")
    values = {attribute: points.read(data, attribute.name) for attribute in needed}
    matrix = np.array(evaluated.matrix_world, np.float64)
    if not np.array_equal(matrix, np.eye(4)):
        values = affine.moved(values, matrix)
    filtered = names.SHOWN.name in data.attributes
    return (
        values[names.ID].astype(np.int32),
        values[names.POSITION],
        values[names.COLOR],
        values[names.OPACITY],
        values[names.RADIUS],
        values[names.SCALE],
        values[names.ROTATION],
        points.read(data, names.SHOWN.name) if filtered else np.ones(len(values[names.ID]), bool),
    )


def statistics(obj: bpy.types.Object, chosen: npt.NDArray[np.bool_]) -> list[str]:
    """What there is to say about some of the object's points, a line each; places in the world."""
    if not chosen.any():
        return ["Nothing is selected"]
    mesh = obj.data
    xyz = affine.moved_places(points.read(mesh, names.POSITION.name)[chosen], np.array(obj.matrix_world, np.float64))
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
            word += " of the anchors" if parts.shows_anchors_alone(obj) else ""
            lines.append(f"{word} {values.mean():.2f} {unit} in the mean, {values.max():.2f} at most")
    return lines
