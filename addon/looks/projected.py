"""Gaussians as the rasteriser that trained them draws them: flat, and sorted by the depths of their centers.

EWA splatting (Zwicker et al. 2002), as in 3D Gaussian Splatting (Kerbl et al. 2023). Each Gaussian is a disc in the
plane of its center's depth, across the axis of the active camera's view: along any ray, discs lie in the order of the
depths. On the disc is what the Jacobian of the projection makes of the Gaussian there, wider by the rasteriser's
filter.
"""

import math
from typing import Any

from .. import materials, names
from ..node_tree import Tree
from .view import View

CORNERS = 12  # of a disc: a ray pays for what lies between its sides and the circle
NEAREST_M = 0.01  # what is nearer to the camera's plane is not drawn
# Beyond this slope of a ray the projection's Jacobian stays: else what lies beside the camera would cover the picture.
# The rasteriser's own bound is 1.3 times the edge of the picture; this is that of a lens of 90 degrees.
STEEPEST = 1.3


def discs(tree: Tree, geometry: Any, shown: Any, view: View, softness: Any, size: Any) -> Any:
    """Every vertex as the disc of its Gaussian, without a material; the disc of radius 1 is where alpha is `FAINTEST`.

    `softness` is the deviation of the filter as a share of the depth, `size` widens all.
    """
    x, y, back = tree.node("ShaderNodeSeparateXYZ", {"Vector": view.place}).outputs
    opacity = tree.named(names.OPACITY.name, names.OPACITY.type)
    seen = tree.logic("AND", tree.compare(back, "LESS_THAN", -NEAREST_M), shown)
    seen = tree.logic("AND", seen, tree.compare(opacity, "GREATER_THAN", materials.FAINTEST))
    mesh = {"Vertices": CORNERS, "Radius": 1 / math.cos(math.pi / CORNERS)}
    disc = tree.node("GeometryNodeMeshCircle", mesh, fill_type="NGON").outputs[0]
    material = materials.material(materials.PROJECTED, lit=False)
    disc = tree.node("GeometryNodeSetMaterial", {"Geometry": disc, "Material": material}).outputs[0]
    inputs = {"Points": geometry, "Selection": seen, "Instance": disc}
    instances = tree.node("GeometryNodeInstanceOnPoints", inputs).outputs[0]

    # Rows of the half covariance, of which all else is made: a determinant from variances would cancel for a needle.
    across, up = (_row(tree, view, axis, tree.math("DIVIDE", side, back)) for axis, side in enumerate((x, y)))
    filter_width = tree.math("MULTIPLY", back, softness)
    filtered = tree.math("MULTIPLY", filter_width, filter_width)
    wide, tall, both = (_dot(tree, *rows) for rows in ((across, across), (up, up), (across, up)))
    turned = tree.vector("CROSS_PRODUCT", across, up)
    trace = tree.math("ADD", wide, tall)
    determinant = tree.math("MULTIPLY_ADD", filtered, tree.math("ADD", trace, filtered), _dot(tree, turned, turned))
    # The ellipse's axes, of which each takes a radius of the disc to it: any other root of the covariance would do, but
    # of two columns that are not perpendicular to each other, Cycles finds the plane with a larger error.
    half = tree.math("MULTIPLY", tree.math("SUBTRACT", wide, tall), 0.5)
    mean = tree.math("MULTIPLY_ADD", trace, 0.5, filtered)
    spread = tree.math("SQRT", tree.math("MULTIPLY_ADD", half, half, tree.math("MULTIPLY", both, both)))
    largest = tree.math("ADD", mean, spread)
    angle = tree.math("MULTIPLY", tree.math("ARCTAN2", both, half), 0.5)
    cosine, sine = tree.math("COSINE", angle), tree.math("SINE", angle)
    # `reach` is where alpha is the faintest, in deviations.
    reach = tree.math("LOGARITHM", tree.math("DIVIDE", opacity, materials.FAINTEST), math.e)
    reach = tree.math("MULTIPLY", tree.math("SQRT", tree.math("MULTIPLY", reach, 2.0)), size)
    long = tree.math("MULTIPLY", reach, tree.math("SQRT", largest))
    short = tree.math("MULTIPLY", reach, tree.math("SQRT", tree.math("DIVIDE", determinant, largest)))
    columns = {
        "Column 1 Row 1": tree.math("MULTIPLY", long, cosine),
        "Column 1 Row 2": tree.math("MULTIPLY", long, sine),
        "Column 2 Row 1": tree.math("MULTIPLY", tree.math("MULTIPLY", short, -1.0), sine),
        "Column 2 Row 2": tree.math("MULTIPLY", short, cosine),
        "Column 4 Row 1": x,
        "Column 4 Row 2": y,
        "Column 4 Row 3": back,
    }
    shape = tree.node("FunctionNodeCombineMatrix", columns).outputs[0]
    placed = tree.group.nodes.new("FunctionNodeMatrixMultiply")
    tree.set(placed.inputs[0], view.to_object)
    tree.set(placed.inputs[1], shape)
    inputs = {"Instances": instances, "Transform": placed.outputs[0]}
    return tree.node("GeometryNodeSetInstanceTransform", inputs).outputs[0]


def _row(tree: Tree, view: View, axis: int, slope: Any) -> Any:
    """How far each axis of the Gaussian, one deviation long, reaches along an axis of the plane, as three numbers.

    The Jacobian's row (1, 0, -slope), or (0, 1, -slope), taken back from the camera to the Gaussian's own axes.
    """
    bounded = tree.math("MINIMUM", tree.math("MAXIMUM", slope, -STEEPEST), STEEPEST)
    row = {"XY"[axis]: 1.0, "Z": tree.math("MULTIPLY", bounded, -1.0)}
    back = tree.node("FunctionNodeTransposeMatrix", {"Matrix": view.to_camera}).outputs[0]
    direction = tree.node("ShaderNodeCombineXYZ", row).outputs[0]
    direction = tree.node("FunctionNodeTransformDirection", {"Direction": direction, "Transform": back}).outputs[0]
    rotation = tree.named(names.ROTATION.name, names.ROTATION.type)
    unturned = tree.node("FunctionNodeInvertRotation", {"Rotation": rotation}).outputs[0]
    own = tree.node("FunctionNodeRotateVector", {"Vector": direction, "Rotation": unturned}).outputs[0]
    return tree.vector("MULTIPLY", own, tree.named(names.SCALE.name, names.SCALE.type))


def _dot(tree: Tree, first: Any, second: Any) -> Any:
    return tree.vector("DOT_PRODUCT", first, second)
