"""The modifier that says what time it is: its inputs, and, once baked, the playback of the keys."""

from collections.abc import Collection
from typing import Any

import bpy

from . import clip_time, modifiers, names
from .node_tree import Tree, socket, versioned_group

VERSION = 5
START, SPEED, REVERSE, OUTSIDE = "Start Frame", "Speed", "Reverse", "Outside the Clip"
BY_HAND, TIME = "Set Time by Hand", "Time"
TRAIL = "Trail"
CLIP_FRAMES, KEY_FIRST, KEY_STEP, KEY_COUNT = "Clip Frames", "First Key", "Key Step", "Key Count"
OUTSIDE_DESCRIPTIONS = {
    clip_time.HOLD: "Before and after the clip its first and last frame hold",
    clip_time.LOOP: "The clip starts over",
    clip_time.BOUNCE: "The clip plays backwards, then forwards again",
}
LONGEST_TRAIL = 30  # frames
MIX_TYPES = {
    "FLOAT": "FLOAT",
    "FLOAT_VECTOR": "VECTOR",
    "FLOAT_COLOR": "RGBA",
    "BYTE_COLOR": "RGBA",
    "QUATERNION": "ROTATION",
}
SWITCH_TYPES = {"FLOAT": "FLOAT", "FLOAT_VECTOR": "VECTOR", "FLOAT_COLOR": "RGBA", "QUATERNION": "ROTATION"}


def live_group() -> bpy.types.NodeTree:
    """The inputs alone: the add-on evaluates the model file and writes the attributes itself."""
    group, made = versioned_group("AdaAnchor4D Live", VERSION)
    if made:
        tree = Tree(group)
        _make_inputs(tree)
        # Unused here; it keeps the menu's items, which come from the node that uses them. It must not ask for the
        # scene's time: Blender would evaluate the object at every frame once more, before it is given the new one.
        rank(tree, 0.0)
        tree.finish(tree.store(tree.input("Geometry"), names.TRAIL, tree.input(TRAIL)))
    return group


def baked_group(attributes: Collection[names.Attribute]) -> bpy.types.NodeTree:
    """Set these attributes from the two keys around the time, linearly between them.

    The inputs are made in the order of `live_group`, so that values and animation survive a change between the two. The
    time includes the sub-frame, so motion blur is right, and nothing of this add-on runs at playback.
    """
    keys = names.keys_of(attributes)
    letters = "".join(key.prefix.removeprefix("aa_") for key in keys)
    group, made = versioned_group(f"AdaAnchor4D Baked {letters.rstrip('_')}", VERSION)
    if not made:
        return group
    tree = Tree(group)
    _make_inputs(tree)
    frame = socket(tree.group.nodes.new("GeometryNodeInputSceneTime").outputs, "Frame")
    last = tree.math("SUBTRACT", tree.input(KEY_COUNT), 1.0)
    place = tree.math("DIVIDE", tree.math("SUBTRACT", rank(tree, frame), tree.input(KEY_FIRST)), tree.input(KEY_STEP))
    place = tree.math("MINIMUM", tree.math("MAXIMUM", place, 0.0), last)
    low = tree.math("FLOOR", place)
    high = tree.math("MINIMUM", tree.math("ADD", low, 1.0), last)
    fraction = tree.math("SUBTRACT", place, low)
    between = tree.compare(fraction, "GREATER_THAN", 1e-5)  # on a key there is nothing to mix: half the work
    geometry = _trail(tree, tree.input("Geometry"), low)
    geometry = tree.store(geometry, names.TRAIL, tree.input(TRAIL))
    for key in keys:
        mix = tree.node("ShaderNodeMix", data_type=MIX_TYPES[key.type])
        tree.set(socket(mix.inputs, "Factor"), fraction)
        at_low, at_high = (tree.named(tree.numbered(key.prefix, 4, n), key.attribute.type) for n in (low, high))
        tree.set(socket(mix.inputs, "A"), at_low)
        tree.set(socket(mix.inputs, "B"), at_high)
        value = tree.switch(SWITCH_TYPES[key.attribute.type], between, at_low, socket(mix.outputs, "Result"))
        if key.attribute == names.POSITION:
            geometry = tree.node("GeometryNodeSetPosition", {"Geometry": geometry, "Position": value}).outputs[0]
        else:
            geometry = tree.store(geometry, key.attribute, value)
        if key.attribute == names.COLOR:
            # Read back: of `value` itself, Blender would mix the keys a second time.
            stored = {"Color": tree.named(names.COLOR.name, names.COLOR.type)}
            alpha = tree.node("FunctionNodeSeparateColor", stored).outputs["Alpha"]
            geometry = tree.store(geometry, names.OPACITY, alpha)
    for key in keys:  # what comes after would copy every one of them to what it makes
        geometry = _without(tree, geometry, key.prefix + "*")
    tree.finish(geometry)
    return group


def rank(tree: Tree, frame: Any) -> Any:
    """`clip_time.ClipTime.rank` as nodes."""
    count = tree.input(CLIP_FRAMES)
    last = tree.math("SUBTRACT", count, 1.0)
    played = tree.math("MULTIPLY", tree.math("SUBTRACT", frame, tree.input(START)), tree.input(SPEED))
    place = tree.switch("FLOAT", tree.input(BY_HAND), played, tree.math("SUBTRACT", tree.input(TIME), 1.0))
    hold = tree.math("MINIMUM", tree.math("MAXIMUM", place, 0.0), last)
    turns = tree.math("FLOOR", tree.math("DIVIDE", place, count))
    loop = tree.math("MINIMUM", tree.math("SUBTRACT", place, tree.math("MULTIPLY", turns, count)), last)
    bounce = tree.math("PINGPONG", place, last)
    values = {clip_time.HOLD: hold, clip_time.LOOP: loop, clip_time.BOUNCE: bounce}
    place = tree.menu(
        "FLOAT", OUTSIDE, [(item, OUTSIDE_DESCRIPTIONS[item], values[item]) for item in clip_time.OUTSIDE]
    )
    return tree.switch("FLOAT", tree.input(REVERSE), place, tree.math("SUBTRACT", last, place))


def clip_time_of(modifier: bpy.types.Modifier) -> clip_time.ClipTime:
    """What the inputs of the time modifier say; of an evaluated object, with animation and drivers."""
    return clip_time.ClipTime(
        frames=max(1, modifiers.get(modifier, CLIP_FRAMES)),
        start=modifiers.get(modifier, START),
        speed=modifiers.get(modifier, SPEED),
        by_hand=bool(modifiers.get(modifier, BY_HAND)),
        time=modifiers.get(modifier, TIME),
        outside=modifiers.get(modifier, OUTSIDE),
        reverse=bool(modifiers.get(modifier, REVERSE)),
    )


def _make_inputs(tree: Tree) -> None:
    tree.open_panel("Time")
    tree.make_input(START, "Float", "The timeline's frame that shows the clip's first frame", default_value=1.0)
    speed = "Frames of the clip for each frame of the timeline; the import sets it so that seconds are kept"
    tree.make_input(SPEED, "Float", speed, default_value=1.0)
    tree.make_input(REVERSE, "Bool", "Play from the last frame to the first")
    tree.make_input(OUTSIDE, "Menu", "What is shown before and after the clip", default_value=clip_time.HOLD)
    tree.make_input(BY_HAND, "Bool", "Show the time below, which can be keyed or driven, and leave the timeline alone")
    tree.make_input(
        TIME, "Float", "The clip's frame to show, from 1; between two frames where it is not whole", default_value=1.0
    )
    trail = "How many earlier frames of the clip (of a bake: keys) show as ghosts of what moved since"
    tree.make_input(TRAIL, "Int", trail, default_value=0, min_value=0, max_value=LONGEST_TRAIL)
    tree.open_panel("Bake", closed=True)
    for name, kind, description, default in (
        (CLIP_FRAMES, "Int", "Frames of the clip; set by the import", 1),
        (KEY_FIRST, "Float", "The clip's frame of the first key, from 0; set by the bake", 0.0),
        (KEY_STEP, "Float", "Frames of the clip from key to key; set by the bake", 1.0),
        (KEY_COUNT, "Int", "Number of keys; set by the bake", 1),
    ):
        tree.make_input(name, kind, description, default_value=default, min_value=default)


def _without(tree: Tree, geometry: Any, pattern: str) -> Any:
    node = tree.node("GeometryNodeRemoveAttribute", {"Geometry": geometry})
    if hasattr(node, "pattern_mode"):  # a menu input from Blender 5.0 on
        node.pattern_mode = "WILDCARD"
    else:
        socket(node.inputs, "Pattern Mode").default_value = "Wildcard"
    tree.set(socket(node.inputs, "Name"), pattern)
    return node.outputs[0]


def _trail(tree: Tree, geometry: Any, low: Any) -> Any:
    """Positions at the keys before this one, in the attributes that the look's ghosts read."""
    start = tree.group.nodes.new("GeometryNodeRepeatInput")
    end = tree.group.nodes.new("GeometryNodeRepeatOutput")
    start.pair_with_output(end)
    tree.set(start.inputs["Iterations"], tree.input(TRAIL))
    tree.set(start.inputs["Geometry"], geometry)
    age = tree.math("ADD", start.outputs["Iteration"], 1.0)
    number = tree.math("MAXIMUM", tree.math("SUBTRACT", low, age), 0.0)
    position = names.keys_of((names.POSITION,))[0]
    value = tree.named(tree.numbered(position.prefix, 4, number), position.type)
    store = tree.node("GeometryNodeStoreNamedAttribute", data_type=position.type, domain="POINT")
    tree.set(socket(store.inputs, "Name"), tree.numbered(names.TRAIL_PREFIX, 2, age))
    tree.set(socket(store.inputs, "Geometry"), start.outputs["Geometry"])
    tree.set(socket(store.inputs, "Value"), value)
    tree.set(end.inputs["Geometry"], store.outputs[0])
    return end.outputs["Geometry"]
