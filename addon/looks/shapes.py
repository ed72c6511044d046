"""Drawing a shape at every point, in the material of its look."""

from typing import Any

from .. import materials
from ..node_tree import Tree
from . import LIT


def instances(tree: Tree, geometry: Any, shown: Any, shape: Any, rotation: Any, scale: Any) -> Any:
    """The shape at every point that is shown, turned and scaled there."""
    inputs = {"Points": geometry, "Selection": shown, "Instance": shape, "Rotation": rotation, "Scale": scale}
    return tree.node("GeometryNodeInstanceOnPoints", inputs).outputs[0]


def with_material(tree: Tree, geometry: Any, look: str) -> Any:
    """The geometry in the glowing material of this look, or in the lit one where the input asks for it."""
    glowing, lit = (materials.material(look, lit=lit) for lit in (False, True))
    chosen = tree.switch("MATERIAL", tree.input(LIT), glowing, lit)
    return tree.node("GeometryNodeSetMaterial", {"Geometry": geometry, "Material": chosen}).outputs[0]
