"""What colours the points: the trained colours, a quantity on a ramp, or a number on a wheel; and paint."""

from typing import Any, NamedTuple

import bpy

from .. import names
from ..node_tree import Tree, socket
from . import COLOR_BY, HIGH, LOW, PAINT, PAINT_SHARE, PLANE, VERSION

TRAINED, ACTIVITY, ID, VEHICLE = "Trained Colour", "Activity", "Anchor", "Vehicle"


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


def color_choice(tree: Tree) -> Any:
    """The number of what colours the points: 0 for the trained colour, then `SCALARS`, then `CATEGORIES`."""
    described = {name: scalar.description for name, scalar in SCALARS.items()} | CATEGORIES
    choices = [(TRAINED, "What the scene was trained to", 0)]
    return tree.menu("INT", COLOR_BY, choices + [(name, described[name], at) for at, name in enumerate(described, 1)])


def colored(tree: Tree, geometry: Any, chosen: Any, encode: Any) -> Any:
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
        color = tree.switch("RGBA", encode, color, encoded(tree, color))
    changed = tree.logic("OR", tree.logic("OR", painted, encode), tree.compare(chosen, "GREATER_THAN", 0.5))
    return tree.switch("GEOMETRY", changed, geometry, tree.store(geometry, names.COLOR, color))


def encoded(tree: Tree, color: Any) -> Any:
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
