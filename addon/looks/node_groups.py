"""The groups that the look modifier runs: the looks, what colours the points, what hides them, ghosts."""

import re

import bpy

from .. import materials, modifiers, names
from ..node_tree import Tree, socket, versioned_group
from . import EDITION, LIT, LOOK, LOOKS, SIZE, SPLATS_KNOWN, TRAINED_PICTURE, VERSION
from .colors import color_choice, colored
from .discs import discs
from .filters import shown
from .gaussians import gaussians
from .inputs import make_inputs
from .spheres import ghosts, spheres, trail_length
from .splats import harmonics_share, splats
from .view import sized

NAME = "AdaAnchor4D Look"


def look_group() -> bpy.types.NodeTree:
    """The group of the look modifier."""
    group, made = versioned_group(NAME, EDITION)
    if not made:
        return group
    tree = Tree(group)
    make_inputs(tree)
    geometry = tree.node("GeometryNodeSetID", {"Geometry": tree.input("Geometry")})
    # Motion blur finds an instance again by its id: filters may hide others from one frame to the next.
    tree.set(socket(geometry.inputs, "ID"), tree.named(names.ID.name, names.ID.type))
    trained = tree.logic("AND", tree.input(TRAINED_PICTURE), tree.logic("NOT", tree.input(LIT)))
    chosen = color_choice(tree)
    geometry = colored(tree, geometry.outputs[0], chosen, trained)
    seen = shown(tree)
    looks = {
        materials.POINTS: spheres(tree, geometry, seen),
        materials.DISCS: discs(tree, geometry, seen),
        materials.GAUSSIANS: gaussians(tree, geometry, seen, trained),
    }
    if SPLATS_KNOWN:
        # Nodes of its own that another Blender does not know make nothing there: then Gaussians stand in.
        cloud = splats(tree, geometry, seen, harmonics_share(tree, chosen, trained))
        count = tree.node("GeometryNodeAttributeDomainSize", {"Geometry": cloud}, component="POINTCLOUD").outputs
        known = tree.compare(socket(count, "Point Count"), "GREATER_THAN", 0.5)
        looks[materials.SPLATS] = tree.switch("GEOMETRY", known, looks[materials.GAUSSIANS], cloud)
    drawn = tree.menu("GEOMETRY", LOOK, [(look, LOOKS[look], looks[look]) for look in LOOKS])
    join = tree.group.nodes.new("GeometryNodeJoinGeometry")
    tree.group.links.new(ghosts(tree, geometry, seen), join.inputs[0])
    tree.group.links.new(drawn, join.inputs[0])
    # Joining copies every attribute, so without ghosts there is none.
    haunted = tree.compare(trail_length(tree, geometry), "GREATER_THAN", 0.5)
    tree.finish(tree.switch("GEOMETRY", haunted, drawn, join.outputs[0]))
    return group


def shown_group() -> bpy.types.NodeTree:
    """The points themselves, in the colours and sizes that the look draws them with, and which of them it draws.

    For exports: the inputs are made in the order of `look_group`, so that values and animation survive the change.
    """
    group, made = versioned_group("AdaAnchor4D Shown", EDITION)
    if not made:
        return group
    tree = Tree(group)
    make_inputs(tree)
    tree.menu("FLOAT", LOOK, [(look, LOOKS[look], 0.0) for look in LOOKS])  # unused: it keeps the menu's items
    geometry = colored(tree, tree.input("Geometry"), color_choice(tree), False)
    geometry = tree.store(geometry, names.SHOWN, shown(tree))
    radius = tree.math("MULTIPLY", tree.named(names.RADIUS.name, names.RADIUS.type), tree.input(SIZE))
    geometry = tree.store(geometry, names.RADIUS, radius)
    tree.finish(tree.store(geometry, names.SCALE, sized(tree)))
    return group


def lacks_splats(group: bpy.types.NodeTree) -> bool:
    """Whether it is a look without splats, of this version or an older one, where this Blender has them."""
    label = str(group.get(names.VERSION_PROPERTY))
    return SPLATS_KNOWN and re.fullmatch(rf"{NAME} \d+", label) is not None and not group.library


def is_older(group: bpy.types.NodeTree) -> bool:
    """Whether it is a look of an older version of this extension."""
    label = re.fullmatch(rf"{NAME} (\d+)( with splats)?", str(group.get(names.VERSION_PROPERTY)))
    return label is not None and int(label[1]) < VERSION and not group.library


def renew(look: bpy.types.Modifier) -> None:
    """Give a look modifier the group of this version; the values of its inputs stay."""
    kept = modifiers.values_of(look)
    look.node_group = look_group()
    for name, value in kept.items():
        if modifiers.values_of(look)[name] != value:
            modifiers.put(look, name, value)
