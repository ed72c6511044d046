"""Geometry Nodes groups, built in Python and versioned: two looks, and the playback of baked keys."""

from collections.abc import Iterable
from typing import Any

import bpy

from . import names

VERSION = 1
KEY_COUNT = "Key Count"
GAUSSIAN_SIGMAS = 3.0  # how far out an ellipsoid reaches: beyond, a Gaussian is under 1.2 % of its peak
MIX_TYPES = {
    "FLOAT": "FLOAT",
    "FLOAT_VECTOR": "VECTOR",
    "FLOAT_COLOR": "RGBA",
    "BYTE_COLOR": "RGBA",
    "QUATERNION": "ROTATION",
}


def socket(sockets: Iterable[Any], name: str) -> Any:
    """The enabled socket of this name: some nodes keep a hidden one of each data type under the same name."""
    return next(candidate for candidate in sockets if candidate.enabled and candidate.name == name)


def points_group(material: bpy.types.Material) -> bpy.types.NodeTree:
    """Draw every vertex as a point of its own radius and colour."""
    group, made = _group("AdaAnchor4D Points")
    if made:
        points = _visible_points(group, "Radius Factor")
        radius = _named(group, names.RADIUS.name, "FLOAT")
        _link(group, _math(group, "MULTIPLY", radius, _input(group, "Radius Factor")), socket(points.inputs, "Radius"))
        _output(group, _with_material(group, points.outputs[0], material))
    return group


def gaussians_group(material: bpy.types.Material) -> bpy.types.NodeTree:
    """Draw every vertex as an ellipsoid with the scale and rotation of its Gaussian."""
    group, made = _group("AdaAnchor4D Gaussians")
    if made:
        points = _visible_points(group, "Scale Factor")
        sphere = group.nodes.new("GeometryNodeMeshIcoSphere")
        socket(sphere.inputs, "Radius").default_value = 1.0
        socket(sphere.inputs, "Subdivisions").default_value = 2
        size = group.nodes.new("ShaderNodeVectorMath")
        size.operation = "SCALE"
        _link(group, _named(group, names.SCALE.name, "FLOAT_VECTOR"), size.inputs[0])
        factor = _math(group, "MULTIPLY", _input(group, "Scale Factor"), GAUSSIAN_SIGMAS)
        _link(group, factor, socket(size.inputs, "Scale"))
        instances = group.nodes.new("GeometryNodeInstanceOnPoints")
        _link(group, points.outputs[0], socket(instances.inputs, "Points"))
        _link(group, _with_material(group, sphere.outputs[0], material), socket(instances.inputs, "Instance"))
        _link(group, _named(group, names.ROTATION.name, "QUATERNION"), socket(instances.inputs, "Rotation"))
        _link(group, size.outputs[0], socket(instances.inputs, "Scale"))
        _output(group, instances.outputs[0])
    return group


def keys_group(carrier: str) -> bpy.types.NodeTree:
    """Set the attributes from the two baked keys around the scene's time, linearly between them.

    The time includes the sub-frame, so motion blur is right, and nothing of this add-on runs at playback.
    """
    group, made = _group(f"AdaAnchor4D Keys ({carrier.title()})")
    if not made:
        return group
    group.interface.new_socket(KEY_COUNT, in_out="INPUT", socket_type="NodeSocketInt")
    last = _math(group, "SUBTRACT", _input(group, KEY_COUNT), 1.0)
    now = socket(group.nodes.new("GeometryNodeInputSceneTime").outputs, "Frame")
    rank = _math(group, "MAXIMUM", _math(group, "SUBTRACT", now, float(names.FIRST_FRAME)), 0.0)
    rank = _math(group, "MINIMUM", rank, last)
    low = _math(group, "FLOOR", rank)
    high = _math(group, "MINIMUM", _math(group, "ADD", low, 1.0), last)
    fraction = _math(group, "SUBTRACT", rank, low)

    geometry = _input(group, "Geometry")
    for key in names.carrier_keys(carrier):
        mix = group.nodes.new("ShaderNodeMix")
        mix.data_type = MIX_TYPES[key.type]
        _link(group, fraction, socket(mix.inputs, "Factor"))
        for index, side in ((low, "A"), (high, "B")):
            named = group.nodes.new("GeometryNodeInputNamedAttribute")
            named.data_type = key.attribute.type
            text = group.nodes.new("FunctionNodeFormatString")
            text.format_items.new("INT", "i")
            socket(text.inputs, "Format").default_value = key.prefix + "{i:04}"
            _link(group, index, text.inputs[1])
            _link(group, text.outputs[0], socket(named.inputs, "Name"))
            _link(group, socket(named.outputs, "Attribute"), socket(mix.inputs, side))
        value = socket(mix.outputs, "Result")
        if key.attribute == names.POSITION:
            place = group.nodes.new("GeometryNodeSetPosition")
            _link(group, geometry, socket(place.inputs, "Geometry"))
            _link(group, value, socket(place.inputs, "Position"))
            geometry = place.outputs[0]
        else:
            geometry = _store(group, geometry, key.attribute, value)
        if key.attribute == names.COLOR:
            split = group.nodes.new("FunctionNodeSeparateColor")
            _link(group, value, split.inputs[0])
            geometry = _store(group, geometry, names.OPACITY, socket(split.outputs, "Alpha"))
    _output(group, geometry)
    return group


def add_modifier(obj: bpy.types.Object, name: str, group: bpy.types.NodeTree) -> bpy.types.Modifier:
    """A Geometry Nodes modifier that runs `group`."""
    modifier = obj.modifiers.new(name, "NODES")
    modifier.node_group = group
    return modifier


def input_names(group: bpy.types.NodeTree) -> list[str]:
    """The inputs of a group that a person sets, in order."""
    items = group.interface.items_tree
    return [item.name for item in items if item.in_out == "INPUT" and item.socket_type != "NodeSocketGeometry"]


def modifier_input(modifier: bpy.types.Modifier, name: str) -> tuple[Any, str]:
    """Where the modifier keeps this input: the owner and the path of the property, as `UILayout.prop` wants them."""
    items = modifier.node_group.interface.items_tree
    identifier = next(item.identifier for item in items if item.in_out == "INPUT" and item.name == name)
    if hasattr(modifier, "properties"):  # 5.2; before, inputs were custom properties of the modifier
        return getattr(modifier.properties.inputs, identifier), "value"
    return modifier, f'["{identifier}"]'


def set_modifier_input(modifier: bpy.types.Modifier, name: str, value: float) -> None:
    """Set an input of a Geometry Nodes modifier."""
    owner, path = modifier_input(modifier, name)
    if path == "value":
        owner.value = value
    else:
        owner[path[2:-2]] = value


def _group(name: str) -> tuple[bpy.types.NodeTree, bool]:
    """The group of this name and version, and whether it was made now and awaits its nodes."""
    for group in bpy.data.node_groups:
        if group.name.startswith(name) and group.get(names.VERSION_PROPERTY) == VERSION and not group.library:
            return group, False
    group = bpy.data.node_groups.new(name, "GeometryNodeTree")
    group[names.VERSION_PROPERTY] = VERSION
    group.is_modifier = True
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    return group, True


def _visible_points(group: bpy.types.NodeTree, factor: str) -> bpy.types.Node:
    """The inputs that both looks share, and the points opaque enough to be drawn."""
    for name, value, largest, description in (
        (factor, 1.0, 100.0, "How large to draw, relative to the trained size"),
        ("Minimum Opacity", 0.05, 1.0, "Points less opaque than this are not drawn"),
    ):
        item = group.interface.new_socket(name, in_out="INPUT", socket_type="NodeSocketFloat", description=description)
        item.default_value, item.min_value, item.max_value = value, 0.0, largest
    points = group.nodes.new("GeometryNodeMeshToPoints")
    _link(group, _input(group, "Geometry"), socket(points.inputs, "Mesh"))
    compare = group.nodes.new("FunctionNodeCompare")
    compare.data_type, compare.operation = "FLOAT", "GREATER_EQUAL"
    _link(group, _named(group, names.OPACITY.name, "FLOAT"), socket(compare.inputs, "A"))
    _link(group, _input(group, "Minimum Opacity"), socket(compare.inputs, "B"))
    _link(group, compare.outputs[0], socket(points.inputs, "Selection"))
    return points


def _link(group: bpy.types.NodeTree, source: Any, target: Any) -> None:
    group.links.new(source, target)


def _input(group: bpy.types.NodeTree, name: str) -> Any:
    return socket(group.nodes.new("NodeGroupInput").outputs, name)


def _output(group: bpy.types.NodeTree, geometry: Any) -> None:
    _link(group, geometry, group.nodes.new("NodeGroupOutput").inputs[0])
    for index, node in enumerate(group.nodes):  # nobody placed them: in rows, so that a person can follow the links
        node.location = (220.0 * (index % 12), -260.0 * (index // 12))


def _named(group: bpy.types.NodeTree, name: str, kind: str) -> Any:
    node = group.nodes.new("GeometryNodeInputNamedAttribute")
    node.data_type = kind
    socket(node.inputs, "Name").default_value = name
    return socket(node.outputs, "Attribute")


def _math(group: bpy.types.NodeTree, operation: str, *values: Any) -> Any:
    node = group.nodes.new("ShaderNodeMath")
    node.operation = operation
    for index, value in enumerate(values):
        if isinstance(value, float):
            node.inputs[index].default_value = value
        else:
            _link(group, value, node.inputs[index])
    return node.outputs[0]


def _store(group: bpy.types.NodeTree, geometry: Any, attribute: names.Attribute, value: Any) -> Any:
    node = group.nodes.new("GeometryNodeStoreNamedAttribute")
    node.data_type, node.domain = attribute.type, "POINT"
    socket(node.inputs, "Name").default_value = attribute.name
    _link(group, geometry, socket(node.inputs, "Geometry"))
    _link(group, value, socket(node.inputs, "Value"))
    return node.outputs[0]


def _with_material(group: bpy.types.NodeTree, geometry: Any, material: bpy.types.Material) -> Any:
    node = group.nodes.new("GeometryNodeSetMaterial")
    socket(node.inputs, "Material").default_value = material
    _link(group, geometry, socket(node.inputs, "Geometry"))
    return node.outputs[0]
