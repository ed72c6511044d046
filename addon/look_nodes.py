"""The modifier that draws the points: the looks, what colours them, what hides them, ghosts of earlier frames."""

import re
from typing import Any, NamedTuple

import bpy

from . import harmonics, materials, modifiers, names, projected
from .node_tree import Tree, socket, versioned_group
from .source import MODEL

NAME, VERSION = "AdaAnchor4D Look", 9
# From 5.3 on Blender draws Gaussians itself. Files go from one Blender to another: the group of one that knows the look
# is not taken for that of one that does not.
SPLATS_KNOWN = hasattr(bpy.types, "GeometryNodePointsSetType")
EDITION = f"{VERSION} with splats" if SPLATS_KNOWN else f"{VERSION}"
LOOK, SIZE, LIT = "Look", "Size", "Lit"
COLOR_BY, PLANE, LOW, HIGH = "Colour By", "Plane", "Low", "High"
MINIMUM_OPACITY, NEAREST, FARTHEST = "Minimum Opacity", "Moved at Least", "Moved at Most"
CROP, CROP_OBJECT = "Crop", "Crop Object"
NO_CROP, INSIDE, OUTSIDE = "Off", "Inside", "Outside"
TRAIL_DISTANCE = "Ghost Distance"
TRAINED_PICTURE, SOFTNESS, HARMONICS = "Trained Picture", "Softness", "Harmonics"

LOOKS = {
    materials.POINTS: "Spheres of the size of what they stand for; the fastest",
    materials.DISCS: "Opaque discs across the thinnest direction of the Gaussians",
    materials.GAUSSIANS: "Ellipsoids with the exact Gaussian falloff",
}
if SPLATS_KNOWN:
    LOOKS[materials.SPLATS] = "Gaussians that Blender draws itself, as a point cloud of splats: the fastest of them"
TRAINED, ACTIVITY, ID, VEHICLE = "Trained Colour", "Activity", "Anchor", "Vehicle"
PAINT, PAINT_SHARE = "Paint", "Paint Strength"


class Scalar(NamedTuple):
    """A quantity that points can be coloured by, and what must be evaluated for it."""

    description: str
    unit: str
    range: tuple[float, float]  # a first one for the legend
    needs: tuple[names.Attribute, ...]


SCALARS = {
    "Displacement": Scalar(
        "How far the anchor, or its vehicle with it, is from its canonical place", "m", (0, 2), (names.DISPLACEMENT,)
    ),
    "Speed": Scalar("How fast the anchor moves, with its vehicle if it has one", "m/s", (0, 15), (names.SPEED,)),
    "Plane Weight": Scalar("The weight of one plane, mean over the channels", "", (0, 1 / 3), names.WEIGHTS),
    "Motion Share": Scalar("The weight of the three planes that have time", "", (0.3, 0.7), names.WEIGHTS),
    "Opacity": Scalar("As trained", "", (0, 1), ()),
    "Reach": Scalar("The radius that a point stands for", "m", (0, 1), ()),
}
CATEGORIES = {
    ACTIVITY: "The activity that the capture's truth knows at the anchor, a colour each",
    ID: "A colour for each anchor",
    VEHICLE: "A colour for each vehicle, grey for what belongs to none",
}
RAMP_NAME = "Legend"
# A perceptually even ramp from dark violet to yellow, linear RGB.
RAMP = (
    (0.0, (0.058, 0.0002, 0.089)),
    (0.25, (0.042, 0.086, 0.257)),
    (0.5, (0.015, 0.283, 0.265)),
    (0.75, (0.114, 0.584, 0.119)),
    (1.0, (0.984, 0.799, 0.018)),
)
DISC_SIGMAS = 1.5
# Blender keeps the colour of a splat as spherical harmonics: sRGB = 0.5 + SH_CONSTANT * the constant term + the others.
SPLAT_TYPE = "3D Gaussian Splat"
# Turns of the axes, w x y z: the first brings x to y to z to x, the second goes back.
TURNS = ((0.5, 0.5, 0.5, 0.5), (0.5, -0.5, -0.5, -0.5))
NO_LIMIT_M = 1e6
USUAL_OPACITY = 0.05  # fainter points hardly show, and cost as much as others


def look_group() -> bpy.types.NodeTree:
    """The group of the look modifier."""
    group, made = versioned_group(NAME, EDITION)
    if not made:
        return group
    tree = Tree(group)
    _make_inputs(tree)
    geometry = tree.node("GeometryNodeSetID", {"Geometry": tree.input("Geometry")})
    # Motion blur finds an instance again by its id: filters may hide others from one frame to the next.
    tree.set(socket(geometry.inputs, "ID"), tree.named(names.ID.name, names.ID.type))
    trained = tree.logic("AND", tree.input(TRAINED_PICTURE), tree.logic("NOT", tree.input(LIT)))
    chosen = _color_choice(tree)
    geometry = _colored(tree, geometry.outputs[0], chosen, trained)
    shown = _shown(tree)
    looks = {
        materials.POINTS: _points(tree, geometry, shown),
        materials.DISCS: _discs(tree, geometry, shown),
        materials.GAUSSIANS: _gaussians(tree, geometry, shown, trained),
    }
    if SPLATS_KNOWN:
        # Nodes of its own that another Blender does not know make nothing there: then Gaussians stand in.
        splats = _splats(tree, geometry, shown, _harmonics_share(tree, chosen, trained))
        count = tree.node("GeometryNodeAttributeDomainSize", {"Geometry": splats}, component="POINTCLOUD").outputs
        known = tree.compare(socket(count, "Point Count"), "GREATER_THAN", 0.5)
        looks[materials.SPLATS] = tree.switch("GEOMETRY", known, looks[materials.GAUSSIANS], splats)
    drawn = tree.menu("GEOMETRY", LOOK, [(look, LOOKS[look], looks[look]) for look in LOOKS])
    join = tree.group.nodes.new("GeometryNodeJoinGeometry")
    tree.group.links.new(_ghosts(tree, geometry, shown), join.inputs[0])
    tree.group.links.new(drawn, join.inputs[0])
    # Joining copies every attribute, so without ghosts there is none.
    haunted = tree.compare(_trail_length(tree, geometry), "GREATER_THAN", 0.5)
    tree.finish(tree.switch("GEOMETRY", haunted, drawn, join.outputs[0]))
    return group


def lacks_splats(group: bpy.types.NodeTree) -> bool:
    """Whether it is a look without splats, of this version or an older one, where this Blender has them."""
    label = str(group.get(names.VERSION_PROPERTY))
    return SPLATS_KNOWN and re.fullmatch(rf"{NAME} \d+", label) is not None and not group.library


def shown_group() -> bpy.types.NodeTree:
    """The points themselves, in the colours and sizes that the look draws them with, and which of them it draws.

    For exports: the inputs are made in the order of `look_group`, so that values and animation survive the change.
    """
    group, made = versioned_group("AdaAnchor4D Shown", EDITION)
    if not made:
        return group
    tree = Tree(group)
    _make_inputs(tree)
    tree.menu("FLOAT", LOOK, [(look, LOOKS[look], 0.0) for look in LOOKS])  # unused: it keeps the menu's items
    geometry = _colored(tree, tree.input("Geometry"), _color_choice(tree), False)
    geometry = tree.store(geometry, names.SHOWN, _shown(tree))
    radius = tree.math("MULTIPLY", tree.named(names.RADIUS.name, names.RADIUS.type), tree.input(SIZE))
    geometry = tree.store(geometry, names.RADIUS, radius)
    tree.finish(tree.store(geometry, names.SCALE, _sized(tree)))
    return group


def _sized(tree: Tree) -> Any:
    """The scales of the points, larger by the input."""
    return tree.vector("SCALE", tree.named(names.SCALE.name, names.SCALE.type), tree.input(SIZE))


def _softened(tree: Tree) -> Any:
    """The scales of the points as the rasteriser that trained them drew them: it widens each Gaussian on the screen.

    `SOFTNESS` is the standard deviation of what it adds, as a share of the depth from the active camera; without one
    nothing is added.
    """
    view = projected.active_view(tree)
    backwards = tree.node("ShaderNodeSeparateXYZ", {"Vector": view.place}).outputs[2]
    depth = tree.math("MAXIMUM", tree.math("MULTIPLY", backwards, -1.0), 0.0)
    added = tree.math("POWER", tree.math("MULTIPLY", depth, tree.input(SOFTNESS)), 2.0)
    scale = tree.named(names.SCALE.name, names.SCALE.type)
    wider = tree.vector("POWER", tree.vector("ADD", tree.vector("MULTIPLY", scale, scale), added), (0.5, 0.5, 0.5))
    soft = tree.logic("AND", view.there, tree.compare(tree.input(SOFTNESS), "GREATER_THAN", 0.0))
    return tree.vector("SCALE", tree.switch("VECTOR", soft, scale, wider), tree.input(SIZE))


def _trail_length(tree: Tree, geometry: Any) -> Any:
    """How many ghosts there are, as one number for all points."""
    sample = tree.group.nodes.new("GeometryNodeSampleIndex")
    sample.data_type = "INT"
    tree.set(socket(sample.inputs, "Geometry"), geometry)
    tree.set(socket(sample.inputs, "Value"), tree.named(names.TRAIL.name, names.TRAIL.type))
    return sample.outputs[0]


def _make_inputs(tree: Tree) -> None:
    tree.make_input(LOOK, "Menu", "What is drawn at every point", default_value=materials.POINTS)
    tree.make_input(
        SIZE,
        "Float",
        "How large to draw, relative to the trained size",
        default_value=1.0,
        min_value=0.0,
        max_value=100.0,
    )
    tree.make_input(LIT, "Bool", "Take light and shadows from the scene, instead of glowing in the trained colours")
    tree.open_panel("Colour")
    tree.make_input(COLOR_BY, "Menu", "What the colours show", default_value=TRAINED)
    tree.make_input(PLANE, "Menu", "The plane whose weight is shown", default_value="xt")
    tree.make_input(LOW, "Float", "The value at the legend's left end")
    tree.make_input(HIGH, "Float", "The value at the legend's right end", default_value=1.0)
    tree.make_input(
        PAINT,
        "Color",
        "Hue and saturation to give the points; how light they are stays",
        default_value=(0.8, 0.02, 0.02, 1),
    )
    tree.make_input(
        PAINT_SHARE,
        "Float",
        "How much of the paint is taken",
        default_value=0.0,
        min_value=0.0,
        max_value=1.0,
        subtype="FACTOR",
    )
    tree.open_panel("Filter")
    tree.make_input(
        MINIMUM_OPACITY,
        "Float",
        "Points less opaque than this are not drawn",
        default_value=USUAL_OPACITY,
        min_value=0.0,
        max_value=1.0,
    )
    for name, description, default in (
        (NEAREST, "Anchors nearer to their canonical place than this are not drawn, metres", 0.0),
        (FARTHEST, "Anchors farther from their canonical place than this are not drawn, metres", NO_LIMIT_M),
    ):
        tree.make_input(name, "Float", description, default_value=default, min_value=0.0, subtype="DISTANCE")
    tree.make_input(CROP, "Menu", "Draw a part of the scene", default_value=NO_CROP)
    tree.make_input(CROP_OBJECT, "Object", "An empty or a cube: its box is -1 to 1 on each of its axes")
    tree.make_input(
        TRAIL_DISTANCE,
        "Float",
        "Ghosts nearer to their anchor than this are not drawn, metres",
        default_value=0.2,
        min_value=0.0,
        subtype="DISTANCE",
    )
    # What is new stands last, so that the numbers by which a modifier keeps the others stay.
    tree.panel = None
    tree.make_input(
        TRAINED_PICTURE,
        "Bool",
        "Blend sRGB values, as training does: the colours are encoded once more, for the view transform Raw. "
        "Set it with the button of this name, which sets the scene too",
    )
    tree.make_input(
        SOFTNESS,
        "Float",
        "How much wider Gaussians are drawn, as a share of their depth: the width of the filter that they were trained "
        "with, which thin ones need; set by the import",
        default_value=0.0,
        min_value=0.0,
        max_value=1.0,
    )
    if SPLATS_KNOWN:
        tree.make_input(
            HARMONICS,
            "Int",
            "Degree of the spherical harmonics by which colours of Native Splats follow every camera, fitted to what "
            "the capture's cameras see; with 0 they are those of Seen From",
            default_value=0,
            min_value=0,
            max_value=harmonics.HIGHEST,
        )


def _color_choice(tree: Tree) -> Any:
    """The number of what colours the points: 0 for the trained colour, then `SCALARS`, then `CATEGORIES`."""
    described = {name: scalar.description for name, scalar in SCALARS.items()} | CATEGORIES
    choices = [(TRAINED, "What the scene was trained to", 0)]
    return tree.menu("INT", COLOR_BY, choices + [(name, described[name], at) for at, name in enumerate(described, 1)])


def _colored(tree: Tree, geometry: Any, chosen: Any, encode: Any) -> Any:
    """The points in the colours of this `_color_choice`; what is not asked for is not computed.

    Where `encode`, a value or a socket, holds, the colours are encoded once more.
    """
    weights = {
        plane: tree.named(weight.name, "FLOAT") for plane, weight in zip(names.PLANES, names.WEIGHTS, strict=True)
    }
    choices = [(plane, f"The plane of {plane[0]} and {plane[1]}", weight) for plane, weight in weights.items()]
    values = {
        "Displacement": tree.named(names.DISPLACEMENT.name, "FLOAT"),
        "Speed": tree.named(names.SPEED.name, "FLOAT"),
        "Plane Weight": tree.menu("FLOAT", PLANE, choices),
        "Motion Share": tree.math("ADD", tree.math("ADD", weights["xt"], weights["yt"]), weights["zt"]),
        "Opacity": tree.named(names.OPACITY.name, "FLOAT"),
        "Reach": tree.named(names.RADIUS.name, "FLOAT"),
    }
    numbers = {
        ACTIVITY: _number_of(tree, names.ACTIVITY),
        ID: tree.named(names.ID.name, "INT"),
        VEHICLE: _number_of(tree, names.GROUP),
    }
    # The menu gives a number, that one the quantity, and one ramp its colour. Every node that is there costs something,
    # chosen or not, and twenty vehicles feel it: above all a group within this one, such as the ramp is.
    quantity = tree.indexed("FLOAT", chosen, [0.0, *values.values(), *numbers.values()])
    ramp, category = _ramp(tree, quantity), _category_color(tree, quantity)
    trained = tree.named(names.COLOR.name, names.COLOR.type)
    color = tree.indexed("RGBA", chosen, [trained, *[ramp] * len(values), *[category] * len(numbers)])
    mix = tree.node("ShaderNodeMix", data_type="RGBA", blend_type="COLOR")
    tree.set(socket(mix.inputs, "Factor"), tree.input(PAINT_SHARE))
    tree.set(socket(mix.inputs, "A"), color)
    tree.set(socket(mix.inputs, "B"), tree.input(PAINT))
    painted = tree.compare(tree.input(PAINT_SHARE), "GREATER_THAN", 0.0)
    color = tree.switch("RGBA", painted, color, socket(mix.outputs, "Result"))
    if encode is not False:
        color = tree.switch("RGBA", encode, color, _encoded(tree, color))
    changed = tree.logic("OR", tree.logic("OR", painted, encode), tree.compare(chosen, "GREATER_THAN", 0.5))
    return tree.switch("GEOMETRY", changed, geometry, tree.store(geometry, names.COLOR, color))


def _encoded(tree: Tree, color: Any) -> Any:
    """Linear colours as sRGB ones (IEC 61966-2-1): below its bend the straight piece is the larger, above the curve."""
    curve = tree.vector("MULTIPLY_ADD", tree.vector("POWER", color, (1 / 2.4,) * 3), (1.055,) * 3, (-0.055,) * 3)
    straight = tree.vector("MINIMUM", tree.vector("MULTIPLY", color, (12.92,) * 3), (12.92 * 0.0031308,) * 3)
    return tree.vector("MAXIMUM", curve, straight)


def _number_of(tree: Tree, attribute: names.Attribute) -> Any:
    """A whole number of each point; -1 where nothing has given it any."""
    node = tree.node("GeometryNodeInputNamedAttribute", {"Name": attribute.name}, data_type="INT")
    return tree.switch("FLOAT", node.outputs["Exists"], -1.0, socket(node.outputs, "Attribute"))


def _ramp(tree: Tree, value: Any) -> Any:
    """The legend's colour of a value: one ramp for all, in a group of its own that the panel shows."""
    node = tree.group.nodes.new("GeometryNodeGroup")
    node.node_tree = legend_group()
    for name, source in (("Value", value), (LOW, tree.input(LOW)), (HIGH, tree.input(HIGH))):
        tree.set(node.inputs[name], source)
    return node.outputs[0]


def legend_group() -> bpy.types.NodeTree:
    """The colours of the legend, from a value and the ends of its range."""
    for group in bpy.data.node_groups:
        if group.get(names.VERSION_PROPERTY) == f"{RAMP_NAME} {VERSION}" and not group.library:
            return group
    group = bpy.data.node_groups.new("AdaAnchor4D Legend", "GeometryNodeTree")
    group[names.VERSION_PROPERTY] = f"{RAMP_NAME} {VERSION}"
    group.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    tree = Tree(group)
    for name in ("Value", LOW, HIGH):
        tree.make_input(name, "Float", "")
    span = tree.math("MAXIMUM", tree.math("SUBTRACT", tree.input(HIGH), tree.input(LOW)), 1e-9)
    place = tree.math("DIVIDE", tree.math("SUBTRACT", tree.input("Value"), tree.input(LOW)), span)
    ramp = tree.node("ShaderNodeValToRGB")
    ramp.name = RAMP_NAME
    tree.set(ramp.inputs[0], place)
    elements = ramp.color_ramp.elements
    while len(elements) < len(RAMP):
        elements.new(0.5)
    for element, (position, color) in zip(elements, RAMP, strict=True):
        element.position, element.color = position, (*color, 1.0)
    tree.finish(ramp.outputs["Color"])
    return group


def _category_color(tree: Tree, number: Any) -> Any:
    """A bright colour for each number, far in hue from those of its neighbours; grey below zero."""
    hue = tree.math("FRACT", tree.math("MULTIPLY", number, 0.61803398875))
    color = tree.node("FunctionNodeCombineColor", mode="HSV")
    for target, value in zip(color.inputs, (hue, 0.75, 0.9, 1.0), strict=True):
        tree.set(target, value)
    return tree.switch("RGBA", tree.compare(number, "LESS_THAN", -0.5), color.outputs[0], (0.2, 0.2, 0.2, 1.0))


def _shown(tree: Tree) -> Any:
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


def _points(tree: Tree, geometry: Any, shown: Any) -> Any:
    """Every vertex as a sphere. What is not shown has no size: motion blur needs the same points at all times."""
    radius = tree.math("MULTIPLY", tree.named(names.RADIUS.name, "FLOAT"), tree.input(SIZE))
    radius = tree.switch("FLOAT", shown, 0.0, radius)
    points = tree.node("GeometryNodeMeshToPoints", {"Mesh": geometry, "Radius": radius})
    return _with_material(tree, points.outputs[0], materials.POINTS)


def _discs(tree: Tree, geometry: Any, shown: Any) -> Any:
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
    return _instances(tree, geometry, shown, _with_material(tree, disc, materials.DISCS), turned, size)


def _gaussians(tree: Tree, geometry: Any, shown: Any, trained: Any) -> Any:
    """Every vertex as an ellipsoid with the scale and rotation of its Gaussian.

    Where the `trained` picture is wanted and there is a camera, as the rasteriser draws it instead.
    """
    sphere = tree.node("GeometryNodeMeshIcoSphere", {"Radius": materials.GAUSSIAN_SIGMAS, "Subdivisions": 2}).outputs[0]
    rotation = tree.named(names.ROTATION.name, "QUATERNION")
    shape = _with_material(tree, sphere, materials.GAUSSIANS)
    ellipsoids = _instances(tree, geometry, shown, shape, rotation, _softened(tree))
    view = projected.active_view(tree)
    discs = projected.discs(tree, geometry, shown, view, tree.input(SOFTNESS), tree.input(SIZE))
    return tree.switch("GEOMETRY", tree.logic("AND", trained, view.there), ellipsoids, discs)


def harmonics_shown(obj: bpy.types.Object, look: bpy.types.Modifier) -> int:
    """How many harmonics the object's look draws, the constant among them; 0 where its colours follow no camera."""
    if not has_harmonics(obj, look) or modifiers.get(look, HARMONICS) == 0:
        return 0
    return harmonics.count(modifiers.get(look, HARMONICS))


def has_harmonics(obj: bpy.types.Object, look: bpy.types.Modifier) -> bool:
    """Whether what the object draws can follow every camera."""
    known = SPLATS_KNOWN and modifiers.has(look, HARMONICS) and modifiers.get(look, LOOK) == materials.SPLATS
    return known and (obj.aa4d.kind, obj.aa4d.carrier) == (MODEL, names.GAUSSIANS)


def _harmonics_share(tree: Tree, chosen: Any, trained: Any) -> Any:
    """By how much harmonics count in each channel: not at all in colours that are not the trained ones.

    Where these are encoded once more, by the slope of the encoding: it is bent, but harmonics add little.
    """
    plain = tree.math("SUBTRACT", 1.0, tree.math("MINIMUM", tree.math("ADD", chosen, tree.input(PAINT_SHARE)), 1.0))
    color = tree.vector("MAXIMUM", tree.named(names.COLOR.name, names.COLOR.type), (1e-4,) * 3)
    slope = tree.vector("MULTIPLY", tree.vector("POWER", color, (1 / 2.4 - 1,) * 3), (1.055 / 2.4,) * 3)
    slope = tree.vector("MINIMUM", slope, (12.92,) * 3)
    return tree.vector("SCALE", tree.switch("VECTOR", trained, (1.0,) * 3, slope), plain)


def _splats(tree: Tree, geometry: Any, shown: Any, share: Any) -> Any:
    """Every vertex as a splat of Blender's own. What is not shown has no opacity and no size, as with points."""
    cloud = tree.node("GeometryNodeMeshToPoints", {"Mesh": geometry}).outputs[0]
    scale = tree.switch("VECTOR", shown, (0.0, 0.0, 0.0), _softened(tree))
    opacity = tree.switch("FLOAT", shown, 0.0, tree.named(names.OPACITY.name, names.OPACITY.type))
    srgb = _encoded(tree, tree.named(names.COLOR.name, names.COLOR.type))
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
    return _with_material(tree, cloud, materials.SPLATS)


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


def _instances(tree: Tree, geometry: Any, shown: Any, shape: Any, rotation: Any, scale: Any) -> Any:
    inputs = {"Points": geometry, "Selection": shown, "Instance": shape, "Rotation": rotation, "Scale": scale}
    return tree.node("GeometryNodeInstanceOnPoints", inputs).outputs[0]


def _ghosts(tree: Tree, geometry: Any, shown: Any) -> Any:
    """Points where what moves was before, smaller the longer ago."""
    count = _trail_length(tree, geometry)
    start = tree.group.nodes.new("GeometryNodeRepeatInput")
    end = tree.group.nodes.new("GeometryNodeRepeatOutput")
    start.pair_with_output(end)
    tree.set(start.inputs["Iterations"], count)
    age = tree.math("ADD", start.outputs["Iteration"], 1.0)
    before = tree.named(tree.numbered(names.TRAIL_PREFIX, 2, age), "FLOAT_VECTOR")
    position = tree.group.nodes.new("GeometryNodeInputPosition").outputs[0]
    moved = tree.compare(tree.vector("DISTANCE", before, position), "GREATER_THAN", tree.input(TRAIL_DISTANCE))
    left = tree.math("SUBTRACT", 1.0, tree.math("DIVIDE", age, tree.math("ADD", count, 1.0)))
    radius = tree.math("MULTIPLY", tree.named(names.RADIUS.name, "FLOAT"), tree.input(SIZE), left)
    inputs = {"Mesh": geometry, "Selection": tree.logic("AND", shown, moved), "Position": before, "Radius": radius}
    ghosts = tree.node("GeometryNodeMeshToPoints", inputs)
    join = tree.group.nodes.new("GeometryNodeJoinGeometry")
    tree.group.links.new(ghosts.outputs[0], join.inputs[0])
    tree.group.links.new(start.outputs["Geometry"], join.inputs[0])
    tree.set(end.inputs["Geometry"], join.outputs[0])
    return _with_material(tree, end.outputs["Geometry"], materials.POINTS)


def _with_material(tree: Tree, geometry: Any, look: str) -> Any:
    """The geometry in the glowing material of this look, or in the lit one where the input asks for it."""
    glowing, lit = (materials.material(look, lit=lit) for lit in (False, True))
    chosen = tree.switch("MATERIAL", tree.input(LIT), glowing, lit)
    return tree.node("GeometryNodeSetMaterial", {"Geometry": geometry, "Material": chosen}).outputs[0]
