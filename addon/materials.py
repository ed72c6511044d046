"""Materials, built in Python: glowing ones, whose colours are the trained ones under the Standard view transform, and
lit ones, which take light and shadows from the scene."""

import bpy

from . import names
from .node_tree import socket

VERSION = 2
POINTS, DISCS, GAUSSIANS, SPLATS = "Points", "Discs", "Gaussians", "Native Splats"
PROJECTED = "Projected Gaussians"  # what the look Gaussians is in the trained picture
RADIANCE = "radiance"  # what a shader calls the colour of a splat of Blender's own, linear, as the ray sees it
GAUSSIAN_SIGMAS = 3.0  # how far out an ellipsoid reaches: beyond, a Gaussian is under 1.2 % of its peak
FAINTEST, MAX_ALPHA = 1 / 255, 0.99  # of a projected Gaussian at a pixel, as the rasteriser bounds them
ID_PASS = "AA Anchor"  # the pass that holds aa_id + 1, so that 0 is where no point is


def material(look: str, *, lit: bool) -> bpy.types.Material:
    """The material of a look."""
    name = f"AdaAnchor4D {look}{' Lit' if lit else ''}"
    label = f"{name} {VERSION}"
    for candidate in bpy.data.materials:
        if candidate.get(names.VERSION_PROPERTY) == label and not candidate.library:
            return candidate
    made = bpy.data.materials.new(name)
    made[names.VERSION_PROPERTY] = label
    if bpy.app.version < (5, 0):  # later ones always have nodes, and warn
        made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    kind = "GEOMETRY" if look in (POINTS, SPLATS) else "INSTANCER"
    color = _attribute(tree, RADIANCE if look == SPLATS else names.COLOR.name, kind).outputs["Color"]
    surface = tree.nodes.new("ShaderNodeBsdfDiffuse" if lit else "ShaderNodeEmission")
    tree.links.new(color, surface.inputs["Color"])
    if look in (GAUSSIANS, PROJECTED):
        mix = tree.nodes.new("ShaderNodeMixShader")
        alpha = _gaussian_alpha(tree) if look == GAUSSIANS else _projected_alpha(tree)
        tree.links.new(alpha, mix.inputs[0])
        tree.links.new(tree.nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[1])
        tree.links.new(surface.outputs[0], mix.inputs[2])
        surface = mix
        made.surface_render_method = "BLENDED"  # sorted by EEVEE: smooth, where DITHERED is noise
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(surface.outputs[0], output.inputs["Surface"])
    id_output = tree.nodes.new("ShaderNodeOutputAOV")
    id_output.aov_name = ID_PASS
    number = _math(tree, "ADD", _attribute(tree, names.ID.name, kind).outputs["Fac"], 1.0)
    tree.links.new(number, socket(id_output.inputs, "Value"))
    # The points glow so that they show their colour, not to light the scene: as lamps they would only slow Cycles down.
    if hasattr(made, "cycles"):  # an add-on, which can be switched off
        made.cycles.emission_sampling = "NONE"
    return made


def _gaussian_alpha(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    """The opacity of an ellipsoid instance whose mesh is a sphere of GAUSSIAN_SIGMAS: the exact Gaussian falloff.

    A ray that passes the centre of the unit Gaussian at distance r sees at most exp(-r^2 / 2). In the instance's own
    coordinates p is a point of the ray and d its direction, so r = |p x d|.
    """
    nodes, link = tree.nodes, tree.links.new
    geometry = nodes.new("ShaderNodeNewGeometry")
    place = nodes.new("ShaderNodeTexCoord").outputs["Object"]
    turn = nodes.new("ShaderNodeVectorTransform")
    turn.vector_type, turn.convert_from, turn.convert_to = "VECTOR", "WORLD", "OBJECT"
    link(geometry.outputs["Incoming"], turn.inputs[0])
    normalize = nodes.new("ShaderNodeVectorMath")
    normalize.operation = "NORMALIZE"
    link(turn.outputs[0], normalize.inputs[0])
    cross = nodes.new("ShaderNodeVectorMath")
    cross.operation = "CROSS_PRODUCT"
    link(place, cross.inputs[0])
    link(normalize.outputs[0], cross.inputs[1])
    squared = nodes.new("ShaderNodeVectorMath")
    squared.operation = "DOT_PRODUCT"
    link(cross.outputs[0], squared.inputs[0])
    link(cross.outputs[0], squared.inputs[1])
    falloff = _math(tree, "EXPONENT", _math(tree, "MULTIPLY", socket(squared.outputs, "Value"), -0.5))
    # A ray enters and leaves the ellipsoid: count it once, where it enters.
    front = _math(tree, "SUBTRACT", 1.0, geometry.outputs["Backfacing"])
    opacity = _attribute(tree, names.OPACITY.name, "INSTANCER").outputs["Fac"]
    return _math(tree, "MULTIPLY", _math(tree, "MULTIPLY", opacity, falloff), front)


def _projected_alpha(tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
    """The opacity of a flat Gaussian on a disc that ends where it has fallen to FAINTEST, at the radius 1."""
    nodes, link = tree.nodes, tree.links.new
    place = nodes.new("ShaderNodeTexCoord").outputs["Object"]
    squared = nodes.new("ShaderNodeVectorMath")
    squared.operation = "DOT_PRODUCT"
    link(place, squared.inputs[0])
    link(place, squared.inputs[1])
    radius = socket(squared.outputs, "Value")
    opacity = _attribute(tree, names.OPACITY.name, "INSTANCER").outputs["Fac"]
    falloff = _math(tree, "POWER", _math(tree, "DIVIDE", FAINTEST, opacity), radius)
    alpha = _math(tree, "MINIMUM", _math(tree, "MULTIPLY", opacity, falloff), MAX_ALPHA)
    return _math(tree, "MULTIPLY", alpha, _math(tree, "LESS_THAN", radius, 1.0))  # the mesh has corners


def _math(tree: bpy.types.NodeTree, operation: str, *values: object) -> bpy.types.NodeSocket:
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    for index, value in enumerate(values):
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, node.inputs[index])
        else:
            node.inputs[index].default_value = value
    return node.outputs[0]


def _attribute(tree: bpy.types.NodeTree, name: str, kind: str) -> bpy.types.Node:
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_name, node.attribute_type = name, kind
    return node
