"""Point attributes of a mesh, written and read as whole numpy arrays."""

from typing import Any

import bpy
import numpy as np
import numpy.typing as npt

from . import names
from .container import ModelFileError
from .field import Indices

# What each attribute type calls its value, and how many numbers it has.
FIELDS = {
    "FLOAT": ("value", 1),
    "INT": ("value", 1),
    "BOOLEAN": ("value", 1),
    "FLOAT_VECTOR": ("vector", 3),
    "FLOAT_COLOR": ("color", 4),
    "BYTE_COLOR": ("color", 4),
    "QUATERNION": ("value", 4),
}
DTYPES = {"INT": np.int32, "BOOLEAN": np.bool_}  # of what is not made of floats


def create_mesh(name: str, ids: npt.NDArray[np.integer]) -> bpy.types.Mesh:
    """A mesh of a loose vertex for each of these rows of the model, with the attributes of every look, unset."""
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(ids))
    for attribute in (*names.APPEARANCE, *names.SHAPE, names.ID):
        if attribute != names.POSITION:
            mesh.attributes.new(attribute.name, attribute.type, "POINT")
    mesh.attributes[names.ID.name].data.foreach_set("value", ids.astype(np.int32))
    mesh.attributes.active_color_name = names.COLOR.name
    return mesh


def write(mesh: bpy.types.Mesh, name: str, kind: str, values: Any) -> None:
    """Set a point attribute from one row a vertex, creating it where it is missing."""
    attribute = mesh.attributes.get(name) or mesh.attributes.new(name, kind, "POINT")
    attribute.data.foreach_set(FIELDS[kind][0], np.ascontiguousarray(values, DTYPES.get(kind, np.float32)).ravel())


def read(data: Any, name: str) -> Any:
    """A point attribute of a mesh or a point cloud, one row a point."""
    attribute = data.attributes[name]
    field, width = FIELDS[attribute.data_type]
    values = np.empty(len(attribute.data) * width, DTYPES.get(attribute.data_type, np.float32))
    attribute.data.foreach_get(field, values)
    return values.reshape(-1, width) if width > 1 else values


def remove(mesh: bpy.types.Mesh, prefixes: tuple[str, ...]) -> None:
    """Remove the attributes whose names begin so."""
    for name in [attribute.name for attribute in mesh.attributes if attribute.name.startswith(prefixes)]:
        mesh.attributes.remove(mesh.attributes[name])


def ids(mesh: bpy.types.Mesh) -> Indices:
    """Which row of the model each vertex shows: vertices deleted or duplicated by hand stay in step.

    Raises:
        ModelFileError: the attribute that says so was removed.
    """
    if names.ID.name not in mesh.attributes:
        raise ModelFileError(f"{mesh.name} has lost its attribute {names.ID.name}; import the model anew.")
    return read(mesh, names.ID.name).astype(np.intp)
