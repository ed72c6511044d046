"""The scene's active camera as the points see it, and the filter of the training at their depths."""

from typing import Any, NamedTuple

from .. import names
from ..node_tree import Tree, socket
from . import SIZE, SOFTNESS


class View(NamedTuple):
    """The active camera, seen from the object."""

    there: Any  # whether there is one
    to_object: Any  # matrix from the camera's coordinates to the object's
    to_camera: Any  # and back; the camera looks along -z
    place: Any  # of each point, in the camera's coordinates


def active_view(tree: Tree) -> View:
    """The scene's active camera, for every point."""
    camera = tree.group.nodes.new("GeometryNodeInputActiveCamera").outputs[0]
    info = tree.node("GeometryNodeObjectInfo", {"Object": camera}, transform_space="RELATIVE")
    to_object = socket(info.outputs, "Transform")
    to_camera = tree.node("FunctionNodeInvertMatrix", {"Matrix": to_object}).outputs["Matrix"]
    position = tree.group.nodes.new("GeometryNodeInputPosition").outputs[0]
    place = tree.node("FunctionNodeTransformPoint", {"Vector": position, "Transform": to_camera}).outputs[0]
    # Without a camera the node gives a place that no camera has: the object's own origin.
    there = tree.compare(tree.vector("LENGTH", socket(info.outputs, "Location")), "GREATER_THAN", 0.0)
    return View(there, to_object, to_camera, place)


def sized(tree: Tree) -> Any:
    """The scales of the points, larger by the input."""
    return tree.vector("SCALE", tree.named(names.SCALE.name, names.SCALE.type), tree.input(SIZE))


def softened(tree: Tree) -> Any:
    """The scales of the points as the rasteriser that trained them drew them: it widens each Gaussian on the screen.

    `SOFTNESS` is the standard deviation of what it adds, as a share of the depth from the active camera; without one
    nothing is added.
    """
    view = active_view(tree)
    backwards = tree.node("ShaderNodeSeparateXYZ", {"Vector": view.place}).outputs[2]
    depth = tree.math("MAXIMUM", tree.math("MULTIPLY", backwards, -1.0), 0.0)
    added = tree.math("POWER", tree.math("MULTIPLY", depth, tree.input(SOFTNESS)), 2.0)
    scale = tree.named(names.SCALE.name, names.SCALE.type)
    wider = tree.vector("POWER", tree.vector("ADD", tree.vector("MULTIPLY", scale, scale), added), (0.5, 0.5, 0.5))
    soft = tree.logic("AND", view.there, tree.compare(tree.input(SOFTNESS), "GREATER_THAN", 0.0))
    return tree.vector("SCALE", tree.switch("VECTOR", soft, scale, wider), tree.input(SIZE))
