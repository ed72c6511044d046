"""Points as spheres, and as ghosts where they were before."""

from typing import Any

from .. import materials, names
from ..node_tree import Tree, socket
from . import SIZE, TRAIL_DISTANCE
from .shapes import with_material


def spheres(tree: Tree, geometry: Any, shown: Any) -> Any:
    """Every vertex as a sphere. What is not shown has no size: motion blur needs the same points at all times."""
    radius = tree.math("MULTIPLY", tree.named(names.RADIUS.name, "FLOAT"), tree.input(SIZE))
    radius = tree.switch("FLOAT", shown, 0.0, radius)
    points = tree.node("GeometryNodeMeshToPoints", {"Mesh": geometry, "Radius": radius})
    return with_material(tree, points.outputs[0], materials.POINTS)


def ghosts(tree: Tree, geometry: Any, shown: Any) -> Any:
    """Points where what moves was before, smaller the longer ago."""
    count = trail_length(tree, geometry)
    start = tree.group.nodes.new("GeometryNodeRepeatInput")
    end = tree.group.nodes.new("GeometryNodeRepeatOutput")
    start.pair_with_output(end)
    tree.set(start.inputs["Iterations"], count)
    age = tree.math("ADD", start.outputs["Iteration"], 1.0)
    before = tree.named(tree.numbered(names.TRAIL_PREFIX, 2, age), "FLOAT_VECTOR")
    position = tree.group.nodes.new("GeometryNodeInputPosition").outputs[0]
    moved = tree.compare(tree.vector("DISTANCE", before, position), "GREATER_THAN", tree.input(TRAIL_DISTANCE))
    left = tree.math("SUBTRACT", 1.0, tree.math("DIVIDE", age, tree.math("ADD", count, 1.0)))
    radius = tree.math("MULTIPLY", tree.named(names.RADIUS.name, "FLOAT"), tree.input(SIZE), left)
    inputs = {"Mesh": geometry, "Selection": tree.logic("AND", shown, moved), "Position": before, "Radius": radius}
    made = tree.node("GeometryNodeMeshToPoints", inputs)
    join = tree.group.nodes.new("GeometryNodeJoinGeometry")
    tree.group.links.new(made.outputs[0], join.inputs[0])
    tree.group.links.new(start.outputs["Geometry"], join.inputs[0])
    tree.set(end.inputs["Geometry"], join.outputs[0])
    return with_material(tree, end.outputs["Geometry"], materials.POINTS)


def trail_length(tree: Tree, geometry: Any) -> Any:
    """How many ghosts there are, as one number for all points."""
    sample = tree.group.nodes.new("GeometryNodeSampleIndex")
    sample.data_type = "INT"
    tree.set(socket(sample.inputs, "Geometry"), geometry)
    tree.set(socket(sample.inputs, "Value"), tree.named(names.TRAIL.name, names.TRAIL.type))
    return sample.outputs[0]
