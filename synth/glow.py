"""Lamps as instances of their own: small shapes whose material shines while they are lit."""

from typing import Any

from synth.city.mesh import Mesh, circle

# A surface whose Blender material is taken as the lamps' base; it also carries the id pass.
BASE = "lamp"


def disc_mesh(radius_m: float) -> Mesh:
    """A flat round lamp that faces +x; origin at its lowest point."""
    mesh = Mesh()
    mesh.polygon([(0.0, y, z + radius_m) for y, z in circle(radius_m, 10)], BASE)
    return mesh


def block_mesh(depth_m: float, width_m: float, height_m: float) -> Mesh:
    """A box-shaped lamp; origin at the centre of its underside."""
    mesh = Mesh()
    mesh.box((-0.5 * depth_m, -0.5 * width_m, 0.0), (0.5 * depth_m, 0.5 * width_m, height_m), BASE)
    return mesh


def make_glow(data: Any, objects: tuple[Any, ...], colours: list[tuple[float, float, float]], strength: float) -> None:
    """Give lamps a material that shines with the object's colour, as much as its alpha says."""
    if not objects:
        return
    material = data.materials[BASE].copy()
    tree = material.node_tree
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    info, power = tree.nodes.new("ShaderNodeObjectInfo"), tree.nodes.new("ShaderNodeMath")
    power.operation = "MULTIPLY"
    power.inputs[1].default_value = strength
    tree.links.new(info.outputs["Alpha"], power.inputs[0])
    tree.links.new(info.outputs["Color"], shader.inputs["Base Color"])
    emission = "Emission Color" if "Emission Color" in shader.inputs else "Emission"  # renamed in Blender 4.0
    tree.links.new(info.outputs["Color"], shader.inputs[emission])
    tree.links.new(power.outputs[0], shader.inputs["Emission Strength"])
    for thing, colour in zip(objects, colours, strict=True):
        thing.data.materials[0] = material
        thing.color = (*colour, 0.0)
