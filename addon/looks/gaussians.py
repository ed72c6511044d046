"""Points as ellipsoids, or as the rasteriser draws them."""

from typing import Any

from .. import materials, names
from ..node_tree import Tree
from . import SIZE, SOFTNESS, projected
from .shapes import instances, with_material
from .view import active_view, softened


def gaussians(tree: Tree, geometry: Any, shown: Any, trained: Any) -> Any:
    """Every vertex as an ellipsoid with the scale and rotation of its Gaussian.

    Where the `trained` picture is wanted and there is a camera, as the rasteriser draws it instead.
    """
    sphere = tree.node("GeometryNodeMeshIcoSphere", {"Radius": materials.GAUSSIAN_SIGMAS, "Subdivisions": 2}).outputs[0]
    rotation = tree.named(names.ROTATION.name, "QUATERNION")
    shape = with_material(tree, sphere, materials.GAUSSIANS)
    ellipsoids = instances(tree, geometry, shown, shape, rotation, softened(tree))
    view = active_view(tree)
    discs = projected.discs(tree, geometry, shown, view, tree.input(SOFTNESS), tree.input(SIZE))
    return tree.switch("GEOMETRY", tree.logic("AND", trained, view.there), ellipsoids, discs)
