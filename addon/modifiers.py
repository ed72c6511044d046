"""Reading and setting the inputs of a Geometry Nodes modifier, in every Blender from 4.5 on."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import bpy

from . import names


def of(obj: bpy.types.Object, name: str) -> bpy.types.Modifier | None:
    """The object's modifier of this name, if it is still there and runs one of our groups."""
    modifier = obj.modifiers.get(name)
    group = modifier.node_group if modifier is not None and modifier.type == "NODES" else None
    return modifier if group is not None and group.get(names.VERSION_PROPERTY) else None


class Input(NamedTuple):
    """An input of a group, as its modifiers store it."""

    identifier: str
    items: tuple[str, ...]  # of a menu; empty for all others


# By group: reading an interface takes longer than reading a value, and twenty vehicles share one group.
_known: dict[tuple[Any, ...], dict[str, Input]] = {}


# By the group's name, while nobody can change a group: even to ask how many nodes it has adds up.
_sure: dict[str, dict[str, Input]] | None = None


@contextmanager
def unchanged_groups() -> Iterator[None]:
    """Trust that no group changes for a while: within one handler, for many objects."""
    global _sure
    _sure = {}
    try:
        yield
    finally:
        _sure = None


def inputs_of(group: bpy.types.NodeTree) -> list[Any]:
    """The interface items of a group's inputs that a person sets, in order."""
    items = [item for item in group.interface.items_tree if item.item_type == "SOCKET" and item.in_out == "INPUT"]
    return [item for item in items if item.socket_type != "NodeSocketGeometry"]


def _inputs(group: bpy.types.NodeTree) -> dict[str, Input]:
    """The inputs of a group by name, remembered while it has as many of them and as many nodes."""
    if _sure is None:
        return _looked_up(group)
    name = group.name_full  # evaluated copies have no session id of their own
    if name not in _sure:
        _sure[name] = _looked_up(group)
    return _sure[name]


def _looked_up(group: bpy.types.NodeTree) -> dict[str, Input]:
    key = (group.session_uid, group.get(names.VERSION_PROPERTY), len(group.interface.items_tree), len(group.nodes))
    if key not in _known:
        _known[key] = {
            item.name: Input(
                item.identifier, menu_items(group, item.name) if item.socket_type == "NodeSocketMenu" else ()
            )
            for item in inputs_of(group)
        }
    return _known[key]


def forget() -> None:
    """Forget all groups."""
    _known.clear()


def property_of(modifier: bpy.types.Modifier, name: str) -> tuple[Any, str]:
    """Where the modifier keeps this input: the owner and the path of the property, as `UILayout.prop` wants them."""
    identifier = _inputs(modifier.node_group)[name].identifier
    if hasattr(modifier, "properties"):  # 5.2; before, inputs were custom properties of the modifier
        return getattr(modifier.properties.inputs, identifier), "value"
    return modifier, f'["{identifier}"]'


def path_of(modifier: bpy.types.Modifier, name: str) -> str:
    """The path of an input from the modifier's object: what keys and drivers want."""
    owner, path = property_of(modifier, name)
    return f"{owner.path_from_id()}.{path}" if path == "value" else f"{modifier.path_from_id()}{path}"


def menu_items(group: bpy.types.NodeTree, name: str) -> tuple[str, ...]:
    """The items of a menu input, in order; none where a person has removed the node that uses it."""
    for node in group.nodes:
        links = node.inputs[0].links if node.bl_idname == "GeometryNodeMenuSwitch" else ()
        if links and links[0].from_socket.name == name:
            return tuple(item.name for item in node.enum_items)
    return ()


def has(modifier: bpy.types.Modifier, name: str) -> bool:
    """Whether there is such an input: a group of an older version may lack it."""
    return name in _inputs(modifier.node_group)


def get(modifier: bpy.types.Modifier, name: str) -> Any:
    """The value of an input; of a menu, the name of the chosen item."""
    owner, path = property_of(modifier, name)
    value = owner.value if path == "value" else owner[path[2:-2]]
    items = _inputs(modifier.node_group)[name].items
    return items[value] if items and not isinstance(value, str) else value


def put(modifier: bpy.types.Modifier, name: str, value: Any) -> None:
    """Set an input; a menu by the name of its item."""
    owner, path = property_of(modifier, name)
    if path == "value":
        owner.value = value
        return
    items = _inputs(modifier.node_group)[name].items
    owner[path[2:-2]] = items.index(value) if items else value


def values_of(modifier: bpy.types.Modifier) -> dict[str, Any]:
    """The values of all inputs, which hold when the modifier is given another group."""
    values = {item.name: get(modifier, item.name) for item in inputs_of(modifier.node_group)}
    return {name: tuple(v) if hasattr(v, "__len__") and not isinstance(v, str) else v for name, v in values.items()}
