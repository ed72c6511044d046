"""The grid of the field's cells as DACW lays them into the world: fine where the model spends its resolution."""

import bpy
import numpy as np

from . import placement
from .container import Floats
from .model import Doubles, Model

CELLS = 32  # lines on an axis: the model's own hundreds would be a solid wall


def grid_planes(model: Model, cells: int = CELLS) -> tuple[Doubles, list[tuple[int, int]]]:
    """Vertices [n, 3] in world metres and edges of the grid on three sides of the field's box: x-y, x-z and y-z.

    Lines stand at equal steps of the warped coordinate, so in the world they crowd where DACW stretches.
    """
    lower, upper = (corner.astype(np.float64) for corner in model.tensors["field.box"])
    lines = [_line_places(model.tensors["warp.boundaries"][axis], cells) for axis in range(3)]
    world = [
        model.scale * (lower[axis] + (lines[axis] + 1) / 2 * (upper[axis] - lower[axis])) + model.translation[axis]
        for axis in range(3)
    ]
    vertices: list[Doubles] = []
    edges: list[tuple[int, int]] = []
    for first, second in ((0, 1), (0, 2), (1, 2)):
        for along, across in ((first, second), (second, first)):
            for place in world[across]:
                ends = np.array([[axis_places[0] for axis_places in world]] * 2)
                ends[:, across] = place
                ends[:, along] = world[along][[0, -1]]
                edges.append((len(vertices), len(vertices) + 1))
                vertices.extend(ends)
    return np.array(vertices), edges


def _line_places(boundaries: Floats, cells: int) -> Doubles:
    """Where, in [-1, 1] of the box, the warped coordinate takes equal steps from end to end: [cells + 1]."""
    uniform = np.linspace(-1, 1, len(boundaries))
    rising = np.maximum.accumulate(boundaries.astype(np.float64)) + 1e-12 * np.arange(len(boundaries))
    return np.interp(np.linspace(-1, 1, cells + 1), rising, uniform)


def create_grid(model: Model, parent: bpy.types.Object) -> bpy.types.Object:
    """The grid as an object of edges that moves with the points and is not rendered."""
    vertices, edges = grid_planes(model)
    matrix = placement.map_of(parent.data)
    if matrix is not None:
        vertices = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    mesh = bpy.data.meshes.new(f"{parent.name} DACW Grid")
    mesh.from_pydata(vertices.tolist(), edges, [])
    grid = bpy.data.objects.new(mesh.name, mesh)
    grid.parent, grid.hide_render, grid.hide_select = parent, True, True
    for collection in parent.users_collection:
        collection.objects.link(grid)
    return grid
