"""Emission materials, built in Python: the colours seen are the trained ones under the Standard view transform."""

import bpy

from . import names
from .nodes import GAUSSIAN_SIGMAS, socket

VERSION = 1


def points_material() -> bpy.types.Material:
    """Opaque, for points."""
    material, made = _material("AdaAnchor4D Points")
    if made:
        tree = material.node_tree
        color = _attribute(tree, names.COLOR.name, "GEOMETRY")
        emission = tree.nodes.new("ShaderNodeEmission")
        tree.links.new(color.outputs["Color"], emission.inputs["Color"])
        _finish(material, emission.outputs[0])
    return material


def gaussians_material() -> bpy.types.Material:
    """For ellipsoid instances whose unit sphere is GAUSSIAN_SIGMAS standard deviations: the exact Gaussian falloff.

    A ray that passes the centre of the unit Gaussian at distance r sees at most exp(-r^2 / 2). In the instance's own
    coordinates p is a point of the ray and d its direction, so r = GAUSSIAN_SIGMAS * |p x d|.
    """
    material, made = _material("AdaAnchor4D Gaussians")
    if not made:
        return material
    tree = material.node_tree
    nodes, link = tree.nodes, tree.links.new

    def math(operation: str, first: object, second: object) -> bpy.types.NodeSocket:
        node = nodes.new("ShaderNodeMath")
        node.operation = operation
        for index, value in enumerate((first, second)):
            if isinstance(value, bpy.types.NodeSocket):
                link(value, node.inputs[index])
            else:
                node.inputs[index].default_value = value
        return node.outputs[0]

    geometry = nodes.new("ShaderNodeNewGeometry")
    coordinates = nodes.new("ShaderNodeTexCoord")
    transform = nodes.new("ShaderNodeVectorTransform")
    transform.vector_type, transform.convert_from, transform.convert_to = "VECTOR", "WORLD", "OBJECT"
    link(geometry.outputs["Incoming"], transform.inputs[0])
    direction = nodes.new("ShaderNodeVectorMath")
    direction.operation = "NORMALIZE"
    link(transform.outputs[0], direction.inputs[0])
    cross = nodes.new("ShaderNodeVectorMath")
    cross.operation = "CROSS_PRODUCT"
    link(coordinates.outputs["Object"], cross.inputs[0])
    link(direction.outputs[0], cross.inputs[1])
    squared = nodes.new("ShaderNodeVectorMath")
    squared.operation = "DOT_PRODUCT"
    link(cross.outputs[0], squared.inputs[0])
    link(cross.outputs[0], squared.inputs[1])
    falloff = math("EXPONENT", math("MULTIPLY", socket(squared.outputs, "Value"), -0.5 * GAUSSIAN_SIGMAS**2), 0.0)
    # A ray enters and leaves the ellipsoid: count it once, where it enters.
    front = math("SUBTRACT", 1.0, geometry.outputs["Backfacing"])
    opacity = _attribute(tree, names.OPACITY.name, "INSTANCER").outputs["Fac"]
    alpha = math("MULTIPLY", math("MULTIPLY", opacity, falloff), front)
    emission = nodes.new("ShaderNodeEmission")
    link(_attribute(tree, names.COLOR.name, "INSTANCER").outputs["Color"], emission.inputs["Color"])
    mix = nodes.new("ShaderNodeMixShader")
    link(alpha, mix.inputs[0])
    link(nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
    link(emission.outputs[0], mix.inputs[2])
    material.surface_render_method = "BLENDED"  # sorted by EEVEE: smooth, where DITHERED is noise
    _finish(material, mix.outputs[0])
    return material


def _material(name: str) -> tuple[bpy.types.Material, bool]:
    """The material of this name and version, and whether it was made now and awaits its nodes."""
    for material in bpy.data.materials:
        if material.name.startswith(name) and material.get(names.VERSION_PROPERTY) == VERSION and not material.library:
            return material, False
    material = bpy.data.materials.new(name)
    material[names.VERSION_PROPERTY] = VERSION
    if bpy.app.version < (5, 0):  # later ones always have nodes, and warn
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material, True


def _attribute(tree: bpy.types.NodeTree, name: str, kind: str) -> bpy.types.Node:
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_name, node.attribute_type = name, kind
    return node


def _finish(material: bpy.types.Material, surface: bpy.types.NodeSocket) -> None:
    output = material.node_tree.nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(surface, output.inputs["Surface"])
    # The points glow so that they show their colour, not to light the scene: as lamps they would only slow Cycles down.
    material.cycles.emission_sampling = "NONE"
