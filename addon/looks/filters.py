"""What hides points."""

from typing import Any

from .. import names
from ..node_tree import Tree, socket
from . import CROP, CROP_OBJECT, FARTHEST, INSIDE, MINIMUM_OPACITY, NEAREST, NO_CROP, OUTSIDE


def shown(tree: Tree) -> Any:
    """Whether a point passes the filters."""
    opaque = tree.compare(tree.named(names.OPACITY.name, "FLOAT"), "GREATER_EQUAL", tree.input(MINIMUM_OPACITY))
    moved = tree.named(names.DISPLACEMENT.name, "FLOAT")
    far = tree.compare(moved, "GREATER_EQUAL", tree.input(NEAREST))
    near = tree.compare(moved, "LESS_EQUAL", tree.input(FARTHEST))
    info = tree.node("GeometryNodeObjectInfo", {"Object": tree.input(CROP_OBJECT)}, transform_space="RELATIVE")
    inverse = tree.node("FunctionNodeInvertMatrix", {"Matrix": socket(info.outputs, "Transform")})
    position = tree.group.nodes.new("GeometryNodeInputPosition").outputs[0]
    local = tree.node("FunctionNodeTransformPoint", {"Vector": position, "Transform": inverse.outputs["Matrix"]})
    split = tree.node("ShaderNodeSeparateXYZ", {"Vector": tree.vector("ABSOLUTE", local.outputs[0])})
    reach = tree.math("MAXIMUM", tree.math("MAXIMUM", split.outputs[0], split.outputs[1]), split.outputs[2])
    outside = tree.compare(reach, "GREATER_THAN", 1.0)
    choices = [
        (NO_CROP, "Everything", True),
        (INSIDE, "What lies in the box of the crop object", tree.logic("NOT", outside)),
        (OUTSIDE, "What lies outside the box of the crop object", outside),
    ]
    cropped = tree.menu("BOOLEAN", CROP, choices)
    return tree.logic("AND", tree.logic("AND", opaque, cropped), tree.logic("AND", far, near))
