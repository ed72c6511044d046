"""Points as flat discs."""

from typing import Any

from .. import materials, names
from ..node_tree import Tree
from . import SIZE
from .shapes import instances, with_material

DISC_SIGMAS = 1.5
# Turns of the axes, w x y z: the first brings x to y to z to x, the second goes back.
TURNS = ((0.5, 0.5, 0.5, 0.5), (0.5, -0.5, -0.5, -0.5))


def discs(tree: Tree, geometry: Any, shown: Any) -> Any:
    """Every vertex as a flat disc across its thinnest axis."""
    scale = tree.named(names.SCALE.name, "FLOAT_VECTOR")
    x, y, z = tree.node("ShaderNodeSeparateXYZ", {"Vector": scale}).outputs
    rotation = tree.named(names.ROTATION.name, "QUATERNION")
    x_thinnest = tree.logic("AND", tree.compare(x, "LESS_THAN", y), tree.compare(x, "LESS_THAN", z))
    y_thinnest = tree.logic("AND", tree.compare(y, "LESS_EQUAL", x), tree.compare(y, "LESS_THAN", z))
    size = tree.node("ShaderNodeCombineXYZ", {"X": x, "Y": y, "Z": 1.0}).outputs[0]
    turned = rotation
    for condition, turn, across in (
        (x_thinnest, TURNS[0], {"X": y, "Y": z, "Z": 1.0}),
        (y_thinnest, TURNS[1], {"X": z, "Y": x, "Z": 1.0}),
    ):
        quaternion = tree.node("FunctionNodeQuaternionToRotation", dict(zip("WXYZ", turn, strict=True))).outputs[0]
        rotate = tree.node("FunctionNodeRotateRotation", rotation_space="LOCAL")
        tree.set(rotate.inputs[0], rotation)
        tree.set(rotate.inputs[1], quaternion)
        turned = tree.switch("ROTATION", condition, turned, rotate.outputs[0])
        size = tree.switch("VECTOR", condition, size, tree.node("ShaderNodeCombineXYZ", across).outputs[0])
    disc = tree.node("GeometryNodeMeshCircle", {"Vertices": 12, "Radius": DISC_SIGMAS}, fill_type="NGON").outputs[0]
    size = tree.vector("SCALE", size, tree.input(SIZE))
    return instances(tree, geometry, shown, with_material(tree, disc, materials.DISCS), turned, size)
