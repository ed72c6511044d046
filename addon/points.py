"""Point attributes of a mesh, written and read as whole numpy arrays."""

import bpy
import numpy as np

from . import names
from .container import Floats
from .field import Indices

# What each attribute type calls its value, and how many numbers it has.
FIELDS = {
    "FLOAT": ("value", 1),
    "INT": ("value", 1),
    "FLOAT_VECTOR": ("vector", 3),
    "FLOAT_COLOR": ("color", 4),
    "BYTE_COLOR": ("color", 4),
    "QUATERNION": ("value", 4),
}


def create_mesh(name: str, count: int, carrier: str) -> bpy.types.Mesh:
    """A mesh of `count` loose vertices with every attribute of the carrier, unset, and the ids 0, 1, 2, ..."""
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(count)
    for attribute in names.CARRIER_ATTRIBUTES[carrier]:
        if attribute != names.POSITION:
            mesh.attributes.new(attribute.name, attribute.type, "POINT")
    mesh.attributes.new(names.ID.name, names.ID.type, "POINT")
    mesh.attributes[names.ID.name].data.foreach_set("value", np.arange(count, dtype=np.int32))
    mesh.attributes.active_color_name = names.COLOR.name
    return mesh


def write(mesh: bpy.types.Mesh, name: str, kind: str, values: Floats) -> None:
    """Set a point attribute from one row a vertex, creating it where it is missing."""
    attribute = mesh.attributes.get(name) or mesh.attributes.new(name, kind, "POINT")
    attribute.data.foreach_set(FIELDS[kind][0], np.ascontiguousarray(values, np.float32).ravel())


def read(mesh: bpy.types.Mesh, name: str) -> Floats:
    """A point attribute, one row a vertex."""
    attribute = mesh.attributes[name]
    field, width = FIELDS[attribute.data_type]
    values = np.empty(len(attribute.data) * width, np.float32)
    attribute.data.foreach_get(field, values)
    return values.reshape(-1, width) if width > 1 else values


def ids(mesh: bpy.types.Mesh) -> Indices:
    """Which row of the model each vertex shows: vertices deleted or duplicated by hand stay in step."""
    values = np.empty(len(mesh.vertices), np.int32)
    mesh.attributes[names.ID.name].data.foreach_get("value", values)
    return values.astype(np.intp)
