"""Importing a model file: the plain function behind the operator."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from . import (
    activity,
    bake,
    looks,
    materials,
    modifiers,
    names,
    parts,
    placement,
    playback,
    points,
    properties,
    time_nodes,
    trained_picture,
)
from .camera import capture_folder, create_camera, show_frames
from .clip import Clip
from .container import Floats, ModelFileError
from .field import Indices
from .looks import node_groups, splats
from .model import Model
from .scene import SAME_RATE, extend_timeline, is_timed, set_timeline, set_up_scene, stretch
from .source import TRACK, Source, point_count


@dataclass(frozen=True)
class ImportOptions:
    """What to make of a model file; see docs/addon.md."""

    carrier: str = names.ANCHORS  # a file that knows no such points shows those that it has
    look: str | None = None  # what suits the carrier where None
    view: str = properties.CAPTURE
    import_camera: bool = True
    background_frames: bool = True
    set_timeline: bool = True
    set_up_scene: bool = False
    trained_picture: bool = False
    harmonics: int = 0  # degree, of the colours of native splats of a model; others have none
    vehicles: bool = True  # an object for each vehicle, where the model has any
    largest: int = 2_000_000  # points


SOFT_PIXELS = 0.3**0.5  # of the capture: standard deviation of the filter that aa4d's rasteriser draws with
MOST_VEHICLES = 1000  # that become objects


@dataclass(frozen=True)
class Imported:
    """What an import made."""

    clip: Clip
    points: bpy.types.Object
    camera: bpy.types.Object | None
    stretch: float  # frames of the timeline for each of the clip


def import_model(
    path: str, scene: bpy.types.Scene, collection: bpy.types.Collection, options: ImportOptions
) -> Imported:
    """Make an object of points that follows the timeline, in world metres, and the capture's camera.

    Raises:
        ModelFileError: the file is unusable, or has more points than asked for; nothing was made.
    """
    path = _chosen(path)
    loaded = playback.load(path)
    source, clip = loaded.source, loaded.source.clip
    carrier = options.carrier if options.carrier in source.known_carriers else source.known_carriers[0]
    gaussians = materials.SPLATS if looks.SPLATS_KNOWN else materials.GAUSSIANS
    look = options.look or (materials.POINTS if carrier == names.ANCHORS else gaussians)
    view = properties.CAPTURE if source.kind == TRACK else options.view  # its colours do not follow a camera
    options = replace(options, carrier=carrier, look=look, view=view)
    count = point_count(source, carrier)
    if count > options.largest:
        instead = "import the anchors, or allow more" if names.ANCHORS in source.known_carriers else "allow more"
        raise ModelFileError(
            f"{clip.path.name} has {count:,} {carrier.lower()}, more than the {options.largest:,} allowed here; "
            f"{instead}."
        )
    model = source.model
    divided = None
    if options.vehicles and model is not None and model.groups is not None:
        divided = parts.rows_of_parts(model)
    if divided is not None and len(divided) > MOST_VEHICLES:
        raise ModelFileError(
            f"{clip.path.name} has {len(divided) - 1:,} vehicles, more than the {MOST_VEHICLES:,} that become "
            "objects; import it without Vehicles as Objects."
        )
    fresh = options.set_timeline and not is_timed(scene)
    place = _Place(loaded, path, 1.0 if fresh else stretch(scene, clip), options)
    with _all_or_nothing():
        obj, camera = _make(place, scene, collection, divided)
        if options.set_up_scene:
            set_up_scene(scene, camera, clip)
        if options.trained_picture or trained_picture.is_on(scene):
            trained_picture.turn(scene, True)
        if options.set_timeline:
            (set_timeline if fresh else extend_timeline)(scene, clip)
            scene.frame_set(min(max(scene.frame_current, scene.frame_start), scene.frame_end))
        for part in parts.parts(obj):
            playback.show(part, scene)
    return Imported(clip, obj, camera, place.stretch)


@dataclass(frozen=True)
class _Place:
    """What the objects of one import have in common."""

    loaded: playback.Loaded
    path: str
    stretch: float  # frames of the timeline for each of the clip, so that its seconds are the scene's
    options: ImportOptions


@contextmanager
def _all_or_nothing() -> Iterator[None]:
    """Remove what has been made in bpy.data where something goes wrong."""
    kinds = ("objects", "meshes", "cameras", "collections", "actions", "images")
    before = {kind: set(getattr(bpy.data, kind)) for kind in kinds}
    try:
        yield
    except BaseException:
        made = [block for kind in kinds for block in getattr(bpy.data, kind) if block not in before[kind]]
        bpy.data.batch_remove(made)
        raise


def _make(
    place: _Place,
    scene: bpy.types.Scene,
    collection: bpy.types.Collection,
    divided: list[tuple[int, Indices]] | None,
) -> tuple[bpy.types.Object, bpy.types.Object | None]:
    """The lead, with its vehicles, and the camera, linked to the collection or to a new one within it."""
    source, options = place.loaded.source, place.options
    name = os.path.basename(os.path.dirname(place.path)) or "AdaAnchor4D"
    obj = _make_object(name, place, np.arange(source.unit_count) if divided is None else divided[0][1])
    collection.objects.link(obj)
    playback.show(obj, scene)  # a model that cannot be evaluated fails here, before anything else is made
    if source.model is not None and divided is not None and len(divided) > 1:
        collection.objects.unlink(obj)
        outer = bpy.data.collections.new(name)
        collection.children.link(outer)
        collection = outer
        collection.objects.link(obj)
        _make_vehicles(obj, place, source.model, divided[1:], collection)
    camera = None
    if options.import_camera:
        camera = create_camera(source.clip, source.reach, f"{name} Camera", place.stretch)
        collection.objects.link(camera)
        if options.background_frames:
            show_frames(camera, source.clip, place.stretch)
    return obj, camera


def _make_object(name: str, place: _Place, rows: Indices) -> bpy.types.Object:
    """The points of some of the units, with the modifiers that play and draw them."""
    loaded, path, options = place.loaded, place.path, place.options
    source, clip = loaded.source, loaded.source.clip
    repeats = source.points_each(options.carrier)
    ids = (rows[:, None] * repeats + np.arange(repeats)).ravel()
    mesh = points.create_mesh(name, ids)
    _write_groups(mesh, source, ids // repeats)
    obj = bpy.data.objects.new(name, mesh)
    settings = obj.aa4d
    settings.filepath = playback.relative(path, os.path.dirname(bpy.data.filepath)) if bpy.data.filepath else path
    settings.last_place, settings.content = path, loaded.content
    settings.kind, settings.carrier, settings.view, settings.fps = source.kind, options.carrier, options.view, clip.fps
    settings.frozen_view = clip.camera_center_at(0.5)
    time = bake.time_modifier(obj)
    modifiers.put(time, time_nodes.CLIP_FRAMES, clip.frame_count)
    modifiers.put(time, time_nodes.SPEED, 1 / place.stretch)
    look = obj.modifiers.new(names.LOOK_MODIFIER, "NODES")
    look.node_group = node_groups.look_group()
    modifiers.put(look, looks.LOOK, options.look)
    modifiers.put(look, looks.SOFTNESS, SOFT_PIXELS / float(clip.camera.K[0, 0]))
    if splats.has_harmonics(obj, look):
        modifiers.put(look, looks.HARMONICS, options.harmonics)
    return obj


def _write_groups(mesh: bpy.types.Mesh, source: Source, units: Indices) -> None:
    """Say of every vertex which vehicle its unit belongs to; nothing where no vehicles are known."""
    group = source.group_of_unit
    if group is not None:
        points.write(mesh, names.GROUP.name, names.GROUP.type, group[units])
    elif names.GROUP.name in mesh.attributes:
        points.remove(mesh, (names.GROUP.name,))


def _make_vehicles(
    first: bpy.types.Object,
    place: _Place,
    model: Model,
    divided: list[tuple[int, Indices]],
    collection: bpy.types.Collection,
) -> None:
    """An object and a handle for each group, in two collections of their own, as children of the lead."""
    vehicles, handles = (bpy.data.collections.new(f"{first.name} {kind}") for kind in ("Vehicles", "Handles"))
    for group, rows in divided:
        name = parts.vehicle_name(model, group)
        vehicle = _make_object(name, place, rows)
        handle = parts.make_handle(model, group, f"{name} Handle", place.stretch)
        vehicle.parent = handle.parent = first
        parts.follow(vehicle, first)
        vehicles.objects.link(vehicle)
        handles.objects.link(handle)
    for inner in (vehicles, handles):
        collection.children.link(inner)


def relink(obj: bpy.types.Object, path: str, scene: bpy.types.Scene) -> None:
    """Let an imported object, and those that were imported with it, show this file from now on.

    Raises:
        ModelFileError: the file is unusable, or has fewer points than the object shows; the object is left as it was.
    """
    path = _chosen(path)
    loaded = playback.load(path)
    together = parts.parts(obj)  # found now: which belong together is told by the content that they show
    for part in together:
        playback.check_fits(part, loaded)
    parts.make_own(together)
    for part in together:
        settings = part.aa4d
        settings.filepath = playback.relative(path, os.path.dirname(bpy.data.filepath)) if bpy.data.filepath else path
        settings.last_place, settings.content = path, loaded.content
        time, fps = bake.time_modifier(part), loaded.source.clip.fps
        modifiers.put(time, time_nodes.CLIP_FRAMES, loaded.source.clip.frame_count)
        if settings.fps > 0 and abs(fps / settings.fps - 1) > SAME_RATE:  # what plays by its seconds goes on doing so
            modifiers.put(time, time_nodes.SPEED, modifiers.get(time, time_nodes.SPEED) * fps / settings.fps)
        settings.fps = fps
        repeats = loaded.source.points_each(settings.carrier)
        _write_groups(part.data, loaded.source, points.ids(part.data) // repeats)
        playback.problems.pop(part.session_uid, None)
    for part in together:
        if part.aa4d.playback == "LIVE":
            placement.forget(part.data)
            playback.show(part, scene)


def _chosen(path: str) -> str:
    """The absolute path of the file that a person chose.

    Raises:
        ModelFileError: none was chosen, or Blender cannot remember such a path.
    """
    if not path:
        raise ModelFileError("No file was chosen; choose the model.safetensors of a run.")
    path = os.path.abspath(bpy.path.abspath(path))
    readable = path.encode(errors="replace").decode()
    if readable != path:
        raise ModelFileError(f"{readable} cannot be read: Blender keeps only paths that are UTF-8; rename it.")
    return path


def label_activity(obj: bpy.types.Object) -> dict[str, int]:
    """Write the activity at each point's unit, in all objects of the import; how many points have which.

    Raises:
        ModelFileError: the model or its capture is not found, or knows no activity.
        RuntimeError: Blender cannot read one of the pictures.
    """
    loaded = playback.loaded_of(obj)
    playback.check_fits(obj, loaded)
    source, clip = loaded.source, loaded.source.clip
    folder = capture_folder(clip)
    if folder is None:
        raise ModelFileError(f"The capture that {clip.path.name} was trained on is not beside it.")
    labels = activity.label_units(
        clip, source.unit_count, folder, lambda frame: _shown_units(loaded, clip.ranks[frame]), _read_labels
    )
    written = []
    for part in parts.parts(obj):
        rows = points.ids(part.data) // source.points_each(part.aa4d.carrier)
        points.write(part.data, names.ACTIVITY.name, names.ACTIVITY.type, labels[rows])
        part.data.update()
        written.append(labels[rows])
    known = ("not seen", *activity.LABELS)
    counts = np.unique(np.concatenate(written), return_counts=True)
    return {known[label + 1]: int(count) for label, count in zip(*counts, strict=True)}


def _shown_units(loaded: playback.Loaded, rank: float) -> Floats:
    """The units [N, 3] at a rank, world metres; NaN for those that are not in the scene then."""
    source = loaded.source
    there = source.there(source.clip.time_of_rank(rank))
    return np.where(there[:, None], loaded.trail(source.known_carriers[0], rank), np.float32(np.nan))


def _read_labels(path: Path) -> np.ndarray:
    """A picture of 8-bit labels [H, W], first row at the top."""
    image = bpy.data.images.load(str(path))
    try:
        image.colorspace_settings.name = "Non-Color"
        width, height = image.size
        pixels = np.empty(width * height * image.channels, np.float32)
        image.pixels.foreach_get(pixels)
        return np.round(255 * pixels.reshape(height, width, -1)[::-1, :, 0]).astype(np.uint8)
    finally:
        bpy.data.images.remove(image)
