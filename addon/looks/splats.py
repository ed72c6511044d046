"""Points as Gaussian splats that Blender draws itself, with harmonics."""

from typing import Any

import bpy

from .. import harmonics, materials, modifiers, names
from ..node_tree import Tree, socket
from ..source import MODEL
from . import HARMONICS, LOOK, PAINT_SHARE, SPLATS_KNOWN
from .colors import encoded
from .shapes import with_material
from .view import softened

# Blender keeps the colour of a splat as spherical harmonics: sRGB = 0.5 + SH_CONSTANT * the constant term + the others.
SPLAT_TYPE = "3D Gaussian Splat"


def splats(tree: Tree, geometry: Any, shown: Any, share: Any) -> Any:
    """Every vertex as a splat of Blender's own. What is not shown has no opacity and no size, as with points."""
    cloud = tree.node("GeometryNodeMeshToPoints", {"Mesh": geometry}).outputs[0]
    scale = tree.switch("VECTOR", shown, (0.0, 0.0, 0.0), softened(tree))
    opacity = tree.switch("FLOAT", shown, 0.0, tree.named(names.OPACITY.name, names.OPACITY.type))
    srgb = encoded(tree, tree.named(names.COLOR.name, names.COLOR.type))
    term = tree.vector("SCALE", tree.vector("SUBTRACT", srgb, (0.5,) * 3), 1 / harmonics.SH_CONSTANT)
    constant = tree.named(names.HARMONICS[0].name, names.HARMONICS[0].type)
    follows = tree.compare(tree.input(HARMONICS), "GREATER_THAN", 0.5)
    term = tree.switch("VECTOR", follows, term, tree.vector("MULTIPLY_ADD", constant, share, term))
    red, green, blue = tree.node("ShaderNodeSeparateXYZ", {"Vector": term}).outputs
    channels = {"Red": red, "Green": green, "Blue": blue, "Alpha": opacity}
    radiance = tree.node("FunctionNodeCombineColor", channels, mode="RGB").outputs[0]
    for attribute, value in (
        (names.SPLAT_SCALE, scale),
        (names.SPLAT_ROTATION, tree.named(names.ROTATION.name, names.ROTATION.type)),
        (names.SPLAT_RADIANCE, radiance),
    ):
        cloud = tree.store(cloud, attribute, value)
    cloud = _with_harmonics(tree, cloud, share)
    cloud = tree.node("GeometryNodePointsSetType", {"Points": cloud, "Type": SPLAT_TYPE}).outputs[0]
    return with_material(tree, cloud, materials.SPLATS)


def _with_harmonics(tree: Tree, cloud: Any, share: Any) -> Any:
    """The splats with the harmonics of degree 1 and above, as many as the input asks for: Blender counts them."""
    start = tree.group.nodes.new("GeometryNodeRepeatInput")
    end = tree.group.nodes.new("GeometryNodeRepeatOutput")
    start.pair_with_output(end)
    side = tree.math("ADD", tree.input(HARMONICS), 1.0)
    tree.set(start.inputs["Iterations"], tree.math("SUBTRACT", tree.math("MULTIPLY", side, side), 1.0))
    tree.set(start.inputs["Geometry"], cloud)
    prefix = names.HARMONICS[0].name.removesuffix("00")
    number = tree.math("ADD", start.outputs["Iteration"], 1.0)
    value = tree.named(tree.numbered(prefix, 2, number), names.HARMONICS[0].type)
    store = tree.node("GeometryNodeStoreNamedAttribute", data_type=names.HARMONICS[0].type, domain="POINT")
    name = tree.numbered(names.SPLAT_HARMONICS_PREFIX, 1, start.outputs["Iteration"])
    tree.set(socket(store.inputs, "Name"), name)
    tree.set(socket(store.inputs, "Geometry"), start.outputs["Geometry"])
    tree.set(socket(store.inputs, "Value"), tree.vector("MULTIPLY", value, share))
    tree.set(end.inputs["Geometry"], store.outputs[0])
    return end.outputs["Geometry"]


def harmonics_share(tree: Tree, chosen: Any, trained: Any) -> Any:
    """By how much harmonics count in each channel: not at all in colours that are not the trained ones.

    Where these are encoded once more, by the slope of the encoding: it is bent, but harmonics add little.
    """
    plain = tree.math("SUBTRACT", 1.0, tree.math("MINIMUM", tree.math("ADD", chosen, tree.input(PAINT_SHARE)), 1.0))
    color = tree.vector("MAXIMUM", tree.named(names.COLOR.name, names.COLOR.type), (1e-4,) * 3)
    slope = tree.vector("MULTIPLY", tree.vector("POWER", color, (1 / 2.4 - 1,) * 3), (1.055 / 2.4,) * 3)
    slope = tree.vector("MINIMUM", slope, (12.92,) * 3)
    return tree.vector("SCALE", tree.switch("VECTOR", trained, (1.0,) * 3, slope), plain)


def has_harmonics(obj: bpy.types.Object, look: bpy.types.Modifier) -> bool:
    """Whether what the object draws can follow every camera."""
    known = SPLATS_KNOWN and modifiers.has(look, HARMONICS) and modifiers.get(look, LOOK) == materials.SPLATS
    return known and (obj.aa4d.kind, obj.aa4d.carrier) == (MODEL, names.GAUSSIANS)


def harmonics_shown(obj: bpy.types.Object, look: bpy.types.Modifier) -> int:
    """How many harmonics the object's look draws, the constant among them; 0 where its colours follow no camera."""
    if not has_harmonics(obj, look) or modifiers.get(look, HARMONICS) == 0:
        return 0
    return harmonics.count(modifiers.get(look, HARMONICS))
