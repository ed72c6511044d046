"""Cycles materials from the table of surfaces. Noise runs in world metres, so every place looks its own."""

from typing import Any

import bpy

from synth.city.surfaces import SURFACES, Surface

TINT = "tint"  # colour attribute of the faces
INSTANCE = "instance_id"  # custom property of objects, and the pass that carries it


def material(name: str) -> Any:
    """The material of a surface, made on first use. It also writes the object's instance id to the id pass."""
    found = bpy.data.materials.get(name)
    if found is not None:
        return found
    surface = SURFACES[name]
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    tree = made.node_tree
    shader = tree.nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = surface.roughness
    shader.inputs["Metallic"].default_value = surface.metallic
    tree.links.new(_colour(tree, surface), shader.inputs["Base Color"])
    _instance_pass(tree)
    return made


def _colour(tree: Any, surface: Surface) -> Any:
    """The socket with the surface's colour: base, times tint or paint, times its variations."""
    if surface.paint == "object":
        colour = tree.nodes.new("ShaderNodeObjectInfo").outputs["Color"]
    else:
        attribute = tree.nodes.new("ShaderNodeAttribute")
        attribute.attribute_name = TINT
        colour = _multiply(tree, attribute.outputs["Color"], surface.colour)
    textured = surface.variation or surface.windows_m
    position = tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"] if textured else None
    for scale, strength in surface.variation:
        noise = tree.nodes.new("ShaderNodeTexNoise")
        noise.inputs["Scale"].default_value = scale
        noise.inputs["Detail"].default_value = 2.0
        tree.links.new(position, noise.inputs["Vector"])
        # Noise gathers around 0.5 with a spread of about 0.15; three times that is the stated strength.
        factor = _map_range(tree, noise.outputs[0], (0.25, 0.75), (1 - strength, 1 + strength))
        colour = _multiply(tree, colour, factor)
    if surface.slabs_m:
        colour = _multiply(tree, colour, _slabs(tree, position, surface.slabs_m))
    if surface.windows_m:
        colour = _multiply(tree, colour, _windows(tree, position, surface.windows_m))
    return colour


def _windows(tree: Any, position: Any, size: float) -> Any:
    """Grey values of a wall with rows of dark windows: the bricks of a pattern over (x + y, z)."""
    split = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(position, split.inputs[0])
    along = tree.nodes.new("ShaderNodeMath")
    tree.links.new(split.outputs["X"], along.inputs[0])
    tree.links.new(split.outputs["Y"], along.inputs[1])
    flat = tree.nodes.new("ShaderNodeCombineXYZ")
    tree.links.new(along.outputs[0], flat.inputs["X"])
    tree.links.new(split.outputs["Z"], flat.inputs["Y"])
    brick = tree.nodes.new("ShaderNodeTexBrick")
    brick.offset = 0.0
    brick.inputs["Scale"].default_value = 1.0
    brick.inputs["Brick Width"].default_value = 0.8 * size
    brick.inputs["Row Height"].default_value = size
    brick.inputs["Mortar Size"].default_value = 0.26 * size
    brick.inputs["Mortar Smooth"].default_value = 0.0
    for name, grey in (("Color1", 0.12), ("Color2", 0.2), ("Mortar", 1.0)):
        brick.inputs[name].default_value = (grey, grey, grey, 1)
    tree.links.new(flat.outputs[0], brick.inputs["Vector"])
    return brick.outputs["Color"]


def _slabs(tree: Any, position: Any, size: float) -> Any:
    """Grey values of staggered slabs with darker joints."""
    brick = tree.nodes.new("ShaderNodeTexBrick")
    brick.inputs["Scale"].default_value = 1.0
    brick.inputs["Brick Width"].default_value = size
    brick.inputs["Row Height"].default_value = size
    brick.inputs["Mortar Size"].default_value = 0.035
    for name, grey in (("Color1", 0.9), ("Color2", 1.1), ("Mortar", 0.6)):
        brick.inputs[name].default_value = (grey, grey, grey, 1)
    tree.links.new(position, brick.inputs["Vector"])
    return brick.outputs["Color"]


def _map_range(tree: Any, value: Any, source: tuple[float, float], target: tuple[float, float]) -> Any:
    node = tree.nodes.new("ShaderNodeMapRange")
    limits = dict(zip(("From Min", "From Max", "To Min", "To Max"), (*source, *target), strict=True))
    for name, limit in limits.items():
        node.inputs[name].default_value = limit
    tree.links.new(value, node.inputs["Value"])
    return node.outputs["Result"]


def _multiply(tree: Any, colour: Any, factor: Any) -> Any:
    """Component-wise product of a socket with a socket or a constant colour."""
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = "MULTIPLY"
    tree.links.new(colour, node.inputs[0])
    if isinstance(factor, tuple):
        node.inputs[1].default_value = factor
    else:
        tree.links.new(factor, node.inputs[1])
    return node.outputs[0]


def carry_instance(imported: Any, name: str) -> Any:
    """A material of somebody else's model, made to write the instance id too; None becomes a plain grey one.

    It becomes opaque: what is seen through a surface adds its id to the surface's own, and files whose format says
    little about alpha (FBX) often come in with 0, which would be invisible.
    """
    made = bpy.data.materials.new(name) if imported is None else imported
    made.use_nodes = True
    for node in made.node_tree.nodes:
        if node.type == "BSDF_PRINCIPLED":
            for link in list(node.inputs["Alpha"].links):
                made.node_tree.links.remove(link)
            node.inputs["Alpha"].default_value = 1.0
    if INSTANCE not in made.node_tree.nodes:
        _instance_pass(made.node_tree)
    return made


def _instance_pass(tree: Any) -> None:
    attribute = tree.nodes.new("ShaderNodeAttribute")
    attribute.attribute_type = "OBJECT"
    attribute.attribute_name = INSTANCE
    output = tree.nodes.new("ShaderNodeOutputAOV")
    output.name = output.aov_name = INSTANCE
    tree.links.new(attribute.outputs["Fac"], output.inputs["Value"])
