"""Building node trees in Python: short words for the nodes that the add-on's groups and materials are made of."""

from collections.abc import Iterable, Sequence
from typing import Any

import bpy

from . import names


def socket(sockets: Iterable[Any], name: str) -> Any:
    """The enabled socket of this name: some nodes keep a hidden one of each data type under the same name."""
    return next(candidate for candidate in sockets if candidate.enabled and candidate.name == name)


def versioned_group(name: str, version: int | str) -> tuple[bpy.types.NodeTree, bool]:
    """The group of this name and version, and whether it was made now and awaits its nodes."""
    for group in bpy.data.node_groups:
        if group.get(names.VERSION_PROPERTY) == f"{name} {version}" and not group.library:
            return group, False
    group = bpy.data.node_groups.new(name, "GeometryNodeTree")
    group[names.VERSION_PROPERTY] = f"{name} {version}"
    group.is_modifier = True
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    return group, True


class Tree:
    """A Geometry Nodes group under construction. Values are sockets, or plain numbers for unlinked inputs."""

    def __init__(self, group: bpy.types.NodeTree) -> None:
        self.group = group
        self.panel: Any = None
        self.menu_defaults: list[tuple[Any, str]] = []  # to set when the menus' nodes, which know the items, are linked

    def open_panel(self, name: str, *, closed: bool = False) -> None:
        """The panel of the modifier that the inputs made from now on stand in."""
        self.panel = self.group.interface.new_panel(name, default_closed=closed)

    def make_input(self, name: str, kind: str, description: str, **settings: Any) -> Any:
        """A new input of the group; `kind` is Float, Int, Bool, Menu, Object. Returns its interface item."""
        item = self.group.interface.new_socket(
            name, in_out="INPUT", socket_type=f"NodeSocket{kind}", description=description, parent=self.panel
        )
        if kind == "Menu":
            self.menu_defaults.append((item, settings.pop("default_value")))
        for key, value in settings.items():
            setattr(item, key, value)
        return item

    def input(self, name: str) -> Any:
        """The value of an input of the group."""
        return socket(self.group.nodes.new("NodeGroupInput").outputs, name)

    def node(self, kind: str, inputs: dict[str, Any] | None = None, **properties: Any) -> Any:
        """A node with these properties and inputs."""
        node = self.group.nodes.new(kind)
        for key, value in properties.items():
            setattr(node, key, value)
        for name, value in (inputs or {}).items():
            self.set(socket(node.inputs, name), value)
        return node

    def set(self, target: Any, value: Any) -> None:
        """Link a socket, or set the default of an unlinked one."""
        if isinstance(value, bpy.types.NodeSocket):
            self.group.links.new(value, target)
        else:
            target.default_value = value

    def math(self, operation: str, *values: Any) -> Any:
        """A Math node; also for MULTIPLY of any number of values."""
        if operation == "MULTIPLY" and len(values) > 2:
            return self.math(operation, self.math(operation, *values[:-1]), values[-1])
        node = self.group.nodes.new("ShaderNodeMath")
        node.operation = operation
        for index, value in enumerate(values):
            self.set(node.inputs[index], value)
        return node.outputs[0]

    def logic(self, operation: str, *values: Any) -> Any:
        """A Boolean Math node."""
        node = self.group.nodes.new("FunctionNodeBooleanMath")
        node.operation = operation
        for index, value in enumerate(values):
            self.set(node.inputs[index], value)
        return node.outputs[0]

    def compare(self, first: Any, operation: str, second: Any) -> Any:
        """Compare two numbers; a boolean."""
        node = self.node("FunctionNodeCompare", {"A": first, "B": second}, data_type="FLOAT", operation=operation)
        return node.outputs[0]

    def switch(self, kind: str, condition: Any, false: Any, true: Any) -> Any:
        """`true` where the condition holds, `false` elsewhere. What is not chosen is not evaluated."""
        inputs = {"Switch": condition, "False": false, "True": true}
        return self.node("GeometryNodeSwitch", inputs, input_type=kind).outputs[0]

    def menu(self, kind: str, name: str, choices: Sequence[tuple[str, str, Any]]) -> Any:
        """The value that the group's menu input `name` chooses from (item, description, value)."""
        node = self.group.nodes.new("GeometryNodeMenuSwitch")
        node.data_type = kind
        # The two items that a new node has are renamed: so the numbers that a modifier stores count from 0.
        for item, _, _ in choices[2:]:
            node.enum_items.new(item)
        for index, (item, description, _) in enumerate(choices):
            node.enum_items[index].name, node.enum_items[index].description = item, description
        self.group.links.new(self.input(name), node.inputs[0])
        for item, _, value in choices:
            self.set(socket(node.inputs, item), value)
        return node.outputs[0]

    def indexed(self, kind: str, number: Any, values: Sequence[Any]) -> Any:
        """The value of this number."""
        node = self.node("GeometryNodeIndexSwitch", {"Index": number}, data_type=kind)
        for _ in values[2:]:  # a new node has two
            node.index_switch_items.new()
        for index, value in enumerate(values):
            self.set(node.inputs[index + 1], value)
        return node.outputs[0]

    def vector(self, operation: str, *values: Any) -> Any:
        """A Vector Math node."""
        node = self.group.nodes.new("ShaderNodeVectorMath")
        node.operation = operation
        targets = [target for target in node.inputs if target.enabled]
        for target, value in zip(targets, values, strict=True):
            self.set(target, value)
        return next(output for output in node.outputs if output.enabled)

    def named(self, name: Any, kind: str) -> Any:
        """A named attribute of the geometry."""
        node = self.node("GeometryNodeInputNamedAttribute", {"Name": name}, data_type=kind)
        return socket(node.outputs, "Attribute")

    def numbered(self, prefix: str, digits: int, number: Any) -> Any:
        """The string of a prefix and a number of so many digits."""
        text = self.group.nodes.new("FunctionNodeFormatString")
        text.format_items.new("INT", "i")
        socket(text.inputs, "Format").default_value = f"{prefix}{{i:0{digits}}}"
        self.group.links.new(number, text.inputs[1])
        return text.outputs[0]

    def store(self, geometry: Any, attribute: names.Attribute, value: Any) -> Any:
        """Set a named attribute; the geometry with it."""
        inputs = {"Name": attribute.name, "Geometry": geometry, "Value": value}
        node = self.node("GeometryNodeStoreNamedAttribute", data_type=attribute.type, domain="POINT")
        for name, value in inputs.items():
            self.set(socket(node.inputs, name), value)
        return node.outputs[0]

    def finish(self, geometry: Any) -> None:
        """Set the group's output, and lay the nodes out in rows: nobody placed them, but a person may read them."""
        self.group.links.new(geometry, self.group.nodes.new("NodeGroupOutput").inputs[0])
        for item, default in self.menu_defaults:
            item.default_value = default
        for index, node in enumerate(self.group.nodes):
            node.location = (220.0 * (index % 12), -260.0 * (index // 12))
