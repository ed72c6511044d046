"""Setting a scene up for CG objects among the reconstruction."""

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Vector

from . import looks, materials, modifiers, names, parts, points, trained_picture
from .container import Floats
from .model import Doubles
from .scene import use_cycles

PLATE, SCENE = "PLATE", "SCENE"
MODES = (
    (SCENE, "All in One Render", "The reconstruction takes light and shadows from the scene, and is rendered with it"),
    (
        PLATE,
        "Over the Footage",
        "The reconstruction only hides what is behind it, a ground catches shadows, and all else is transparent",
    ),
)
CLEARANCE_M = 0.4  # what is nearer to the ground than this does not hide: it would hide the shadows that lie there
FIT_ROUNDS = 8


@dataclass(frozen=True)
class Ground:
    """The plane z = slope . (x, y) + height, and the part of it that the points cover."""

    slope: Doubles  # [2]
    height: float
    lower: Doubles  # [2], metres
    upper: Doubles  # [2]

    def z(self, xy: Doubles) -> Doubles:
        """Heights at xy [..., 2]."""
        return xy @ self.slope + self.height


def fit_ground(positions: Floats) -> Ground:
    """The plane that most points [n, 3] lie on, seen from above: least squares with weights that fall off quickly above
    the plane, since things stand on the ground and not in it."""
    xyz = positions.astype(np.float64)
    center = np.median(xyz, axis=0)
    low, high = np.percentile(xyz[:, :2], [2, 98], axis=0)
    inside = ((xyz[:, :2] >= low) & (xyz[:, :2] <= high)).all(axis=1)
    local = xyz[inside if inside.sum() >= 3 else slice(None)] - center
    design = np.column_stack([local[:, :2], np.ones(len(local))])
    weights = np.ones(len(local))
    solution = np.zeros(3)
    for _ in range(FIT_ROUNDS):
        root = np.sqrt(weights)[:, None]
        solution = np.linalg.lstsq(design * root, local[:, 2] * root[:, 0], rcond=None)[0]
        above = local[:, 2] - design @ solution
        spread = max(float(np.median(np.abs(above))), 1e-3)
        weights = np.where(above > 0, np.exp(-np.minimum(above / spread, 50)), 1 / (1 + (above / (2 * spread)) ** 2))
    height = float(solution[2] + center[2] - solution[:2] @ center[:2])
    return Ground(solution[:2], height, low, high)


def set_up(context: bpy.types.Context, obj: bpy.types.Object, mode: str, *, sun: bool, passes: bool) -> None:
    """Set scene, objects of the import and passes up; what an earlier call made is made anew."""
    scene, together = context.scene, parts.parts(obj)
    trained_picture.turn(scene, False)  # light adds up linearly
    obj = together[0]
    opacity = points.read(obj.data, names.OPACITY.name)
    positions = points.read(obj.data, names.POSITION.name)
    ground = fit_ground(positions[opacity >= 0.5] if (opacity >= 0.5).sum() >= 3 else positions)
    for kind in ("Ground", "Occluders"):
        old = bpy.data.objects.get(f"{obj.name} {kind}")
        if old is not None:
            bpy.data.objects.remove(old)
    over_plate = mode == PLATE
    scene.render.film_transparent = over_plate
    use_cycles(scene)
    occluders = None
    if over_plate:
        _make_ground(obj, ground)
        highest = max(float(points.read(part.data, names.POSITION.name)[:, 2].max(initial=-1e4)) for part in together)
        occluders = _make_occluders(obj, ground, highest)
    for part in together:
        part.is_holdout = over_plate
        part.visible_shadow = not over_plate
        look = modifiers.of(part, names.LOOK_MODIFIER)
        if look is not None:
            modifiers.put(look, looks.LIT, not over_plate)
            modifiers.put(look, looks.CROP, looks.INSIDE if over_plate else looks.NO_CROP)
            if occluders is not None:
                modifiers.put(look, looks.CROP_OBJECT, occluders)
    if sun and not any(other.type == "LIGHT" for other in scene.objects):
        _make_sun(obj)
    if passes:
        _make_passes(context.view_layer)


def _make_ground(obj: bpy.types.Object, ground: Ground) -> None:
    corners = [(x, y) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    xy = np.array([[(ground.lower, ground.upper)[i][axis] for axis, i in enumerate(corner)] for corner in corners])
    mesh = bpy.data.meshes.new(f"{obj.name} Ground")
    mesh.from_pydata(np.column_stack([xy, ground.z(xy)]).tolist(), [], [(0, 1, 2, 3)])
    plane = bpy.data.objects.new(mesh.name, mesh)
    plane.is_shadow_catcher, plane.parent = True, obj
    _link_beside(obj, plane)


def _make_occluders(obj: bpy.types.Object, ground: Ground, highest: float) -> bpy.types.Object:
    """A box around what stands on the ground, up to `highest` metres."""
    middle = (ground.lower + ground.upper) / 2
    floor = float(ground.z(middle)) + CLEARANCE_M
    top = max(highest, floor + 1.0)
    box = bpy.data.objects.new(f"{obj.name} Occluders", None)
    box.empty_display_type, box.parent = "CUBE", obj
    box.location = (*middle, (floor + top) / 2)
    # Tilted with the ground, so that its floor stays at the same height above it.
    normal = np.array([-ground.slope[0], -ground.slope[1], 1.0])
    box.rotation_euler = Vector((0, 0, 1)).rotation_difference(Vector(normal)).to_euler()
    box.scale = (*(ground.upper - ground.lower), (top - floor) / 2)
    _link_beside(obj, box)
    bpy.context.view_layer.update()
    return box


def _make_sun(obj: bpy.types.Object) -> None:
    data = bpy.data.lights.new("AdaAnchor4D Sun", "SUN")
    data.energy, data.angle = 3.0, 0.01
    sun = bpy.data.objects.new(data.name, data)
    sun.rotation_euler = (0.7, 0.0, 0.9)
    _link_beside(obj, sun)


def _make_passes(layer: bpy.types.ViewLayer) -> None:
    """Depth, ids of objects (Cryptomatte), and the row of the anchor + 1 as a pass of its own."""
    layer.use_pass_z = layer.use_pass_cryptomatte_object = True
    if materials.ID_PASS not in [aov.name for aov in layer.aovs]:
        aov = layer.aovs.add()
        aov.name, aov.type = materials.ID_PASS, "VALUE"


def _link_beside(obj: bpy.types.Object, other: bpy.types.Object) -> None:
    for collection in obj.users_collection:
        collection.objects.link(other)
