"""Live playback: one function brings every live object of a scene to the timeline's time."""

import dataclasses
import functools
import hashlib
import os
import stat
import time
from collections.abc import Iterable
from dataclasses import dataclass

import bpy
import numpy as np

from . import (
    affine,
    looks,
    materials,
    modifiers,
    names,
    parts,
    placement,
    points,
    properties,
    time_nodes,
)
from .clip_time import ClipTime
from .container import Floats, ModelFileError
from .header import Doubles
from .looks import colors, splats
from .source import MODEL, TRACK, Source, Values, point_count, read_source

FRAMES_KEPT_BYTES = 256 * 2**20  # of evaluated frames, so that playing them again costs no more than the copy
PIECE = 2**20  # bytes at a time, of a file whose hash is taken
QUICK_SHARE = 99  # percent of the points whose error is told
TRAILS_KEPT = 2 * time_nodes.LONGEST_TRAIL
ERRORS_KEPT = 1000
KIND_WORDS = {MODEL: "a model file", TRACK: "a track file"}
STANDS_STILL = "it belongs to another file and stands still here; bake it there, or make it and its data local."


@dataclass(frozen=True)
class Loaded:
    """A file that can be shown, and what of it was asked for last."""

    source: Source
    content: str  # hash of the file
    frames: dict[str, Values] = dataclasses.field(default_factory=dict)  # by stamp
    trails: dict[tuple[str, float], Floats] = dataclasses.field(default_factory=dict)  # positions by carrier and rank
    center: dict[float, Doubles] = dataclasses.field(default_factory=dict)  # of the capture's camera, at the last t
    errors: dict[str, tuple[float, float] | None] = dataclasses.field(default_factory=dict)  # of harmonics, by stamp

    def camera_center(self, t: float) -> Doubles:
        """`Clip.camera_center_at`, remembered: all objects of an import ask for the same."""
        if t not in self.center:
            self.center.clear()
            self.center[t] = self.source.clip.camera_center_at(t)
        return self.center[t]

    def frame(
        self, stamp: str, carrier: str, t: float, center: Doubles, wanted: frozenset[names.Attribute], quick: bool
    ) -> Values:
        """`Source.evaluate`, remembered under a stamp that tells these arguments apart; the latest are kept."""
        if stamp not in self.frames:
            values = self.source.evaluate(carrier, t, center, wanted, quick=quick)
            size = sum(value.nbytes for value in values.values())
            while self.frames and (len(self.frames) + 1) * size > FRAMES_KEPT_BYTES:
                del self.frames[next(iter(self.frames))]
            self.frames[stamp] = values
        return self.frames[stamp]

    def color_errors(self, stamp: str, t: float, center: Doubles) -> tuple[float, float] | None:
        """`Source.color_errors` of the frame that is kept under this stamp."""
        if stamp not in self.errors:
            while len(self.errors) >= ERRORS_KEPT:
                del self.errors[next(iter(self.errors))]
            self.errors[stamp] = self.source.color_errors(t, center, self.frames[stamp])
        return self.errors[stamp]

    def trail(self, carrier: str, rank: float) -> Floats:
        """The positions at a frame of the clip; the latest ones asked for are kept."""
        key = (carrier, rank)
        if key not in self.trails:
            while len(self.trails) >= TRAILS_KEPT:
                del self.trails[next(iter(self.trails))]
            self.trails[key] = self.source.positions(carrier, self.source.clip.time_of_rank(rank))
        return self.trails[key]


@dataclass(frozen=True)
class Moment:
    """What an object shows of its model, and from where."""

    rank: float  # of the clip's frame
    t: float
    center: tuple[float, float, float]  # where it is seen from, world metres as the model has them
    trail: int  # ghosts
    quick: bool  # for the moment that the timeline stays there


# For the panel: the cost of the last evaluation, how far its points were from their places while the timeline played,
# by how much its colours are off with harmonics and without, and the last problem, by the object's session id.
milliseconds: dict[int, float] = {}
quick_errors_m: dict[int, float] = {}
color_errors: dict[int, tuple[float, float] | None] = {}
problems: dict[int, str] = {}


def is_playing() -> bool:
    """Whether somebody watches the timeline play: a render or a script sees every frame exact."""
    manager = bpy.context.window_manager
    return not bpy.app.is_job_running("RENDER") and any(
        window.screen.is_animation_playing for window in ([] if manager is None else manager.windows)
    )


def load(path: str) -> Loaded:
    """The model or track in a file, kept while the file stays the same.

    Raises:
        ModelFileError: as `read_source`, or there is not enough memory.
    """
    try:
        status = os.stat(path)
    except OSError as error:
        raise ModelFileError(f"{os.path.basename(path)} cannot be read: {error.strerror or error}.") from error
    if not stat.S_ISREG(status.st_mode):  # reading a pipe would wait for ever
        raise ModelFileError(f"{path} cannot be read: it is not a file; choose the model.safetensors of a run.")
    try:
        return _load(path, status.st_mtime_ns, status.st_size)
    except MemoryError as error:
        raise ModelFileError(f"{os.path.basename(path)} does not fit into the memory of this machine.") from error


@functools.lru_cache(maxsize=4)
def _load(path: str, _modified_ns: int, _size: int) -> Loaded:
    source = read_source(path)
    content = hashlib.blake2b(digest_size=16)
    with open(path, "rb") as file:
        while piece := file.read(PIECE):
            content.update(piece)
    return Loaded(source, content.hexdigest())


def loaded_of(obj: bpy.types.Object) -> Loaded:
    """The model that an imported object shows, from where its path says or where it was last.

    Raises:
        ModelFileError: the file is unusable, or is no longer the one that the object was made from.
    """
    path = os.path.normpath(bpy.path.abspath(obj.aa4d.filepath, library=obj.library))
    if not os.path.isfile(path) and os.path.isfile(obj.aa4d.last_place):
        path = obj.aa4d.last_place
    if not os.path.exists(path):
        raise ModelFileError(f"{os.path.basename(path)} cannot be read: it is not at {path}; use Relink.")
    loaded = load(path)
    if obj.aa4d.content and loaded.content != obj.aa4d.content:
        raise ModelFileError(
            f"{os.path.basename(path)} is no longer the file that {parts.lead(obj).name} was made from; use Relink to "
            "take it."
        )
    return loaded


def check_fits(obj: bpy.types.Object, loaded: Loaded) -> None:
    """Raises ModelFileError where the file lacks points that the object shows, or is of another kind."""
    mesh, source = obj.data, loaded.source
    if source.kind != obj.aa4d.kind:
        held, shown = (KIND_WORDS[kind] for kind in (source.kind, obj.aa4d.kind))
        raise ModelFileError(f"{source.clip.path.name} is {held}, and {obj.name} shows {shown}; import it anew.")
    if len(mesh.vertices) and points.ids(mesh).max() >= point_count(source, obj.aa4d.carrier):
        raise ModelFileError(f"{source.clip.path.name} has fewer points than {obj.name} shows; import it anew.")


def clip_time_of(obj: bpy.types.Object, frames: int) -> ClipTime:
    """How the timeline maps to the clip for this object, or one to one where its time modifier was removed."""
    modifier = modifiers.of(obj, names.TIME_MODIFIER)
    return (
        ClipTime(frames) if modifier is None else dataclasses.replace(time_nodes.clip_time_of(modifier), frames=frames)
    )


def wanted_of(obj: bpy.types.Object) -> frozenset[names.Attribute]:
    """What the object's look shows or filters by, beside what every look needs."""
    wanted: set[names.Attribute] = set(names.SHAPE) if obj.aa4d.carrier == names.GAUSSIANS else set()
    modifier = modifiers.of(obj, names.LOOK_MODIFIER)
    if modifier is None:
        return frozenset(wanted)
    if modifiers.get(modifier, looks.LOOK) != materials.POINTS:
        wanted.update(names.SHAPE)
    wanted.update(names.HARMONICS[: splats.harmonics_shown(obj, modifier)])
    scalar = colors.SCALARS.get(modifiers.get(modifier, looks.COLOR_BY))
    if scalar is not None:
        wanted.update(scalar.needs)
    if modifiers.get(modifier, looks.NEAREST) > 0 or modifiers.get(modifier, looks.FARTHEST) < looks.NO_LIMIT_M:
        wanted.add(names.DISPLACEMENT)
    return frozenset(wanted)


def camera_center(
    obj: bpy.types.Object, loaded: Loaded, t: float, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph | None
) -> Doubles:
    """Where the points are seen from, [3], in the model's metres: the object, or its mesh, may have been moved.

    All objects of an import are seen from where its lead is: they share one evaluation.
    """
    obj, camera = parts.lead(obj), scene.camera
    if obj.aa4d.view == properties.FROZEN:
        return np.array(obj.aa4d.frozen_view, np.float64)
    if obj.aa4d.view == properties.ACTIVE and camera is not None:
        if depsgraph is not None:
            camera, obj = camera.evaluated_get(depsgraph), obj.evaluated_get(depsgraph)
        return seen_from(obj, camera)
    return loaded.camera_center(t)


def seen_from(obj: bpy.types.Object, camera: bpy.types.Object) -> Doubles:
    """The camera's place [3] in the metres of the model that an imported object shows."""
    place = obj.matrix_world.inverted_safe() @ camera.matrix_world.translation
    return placement.from_mesh(obj.original.data, np.array(place, np.float64))


def moment_of(
    obj: bpy.types.Object, loaded: Loaded, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph | None
) -> Moment:
    """What the object is to show at the scene's (fractional) frame."""
    clip = loaded.source.clip
    evaluated = obj if depsgraph is None else obj.evaluated_get(depsgraph)  # with its animation and drivers
    rank = clip_time_of(evaluated, clip.frame_count).rank(scene.frame_current_final)
    t = clip.time_of_rank(rank)
    x, y, z = camera_center(obj, loaded, t, scene, depsgraph).tolist()
    return Moment(rank, t, (x, y, z), trail_length(evaluated), is_playing())


def show(
    obj: bpy.types.Object,
    scene: bpy.types.Scene,
    depsgraph: bpy.types.Depsgraph | None = None,
    wanted: frozenset[names.Attribute] | None = None,
    together: frozenset[names.Attribute] = frozenset(),
    loaded: Loaded | None = None,
) -> None:
    """Set the object's attributes to their values at the scene's (fractional) frame; does nothing if they are.

    `wanted` is `wanted_of` the object and `loaded` its model, where they are known; `together` is what the other
    objects of this model want: evaluated with it, the frame serves them too.

    Raises:
        ModelFileError: as `loaded_of`.
    """
    loaded = loaded_of(obj) if loaded is None else loaded
    mesh, carrier = obj.data, obj.aa4d.carrier
    moment = moment_of(obj, loaded, scene, depsgraph)
    if wanted is None:
        wanted = wanted_of(obj if depsgraph is None else obj.evaluated_get(depsgraph))
    if moment.quick:  # a fit takes too long: harmonics stay those of where the timeline last stood
        wanted, together = wanted.difference(names.HARMONICS), together.difference(names.HARMONICS)
    stamp = _stamp(loaded, carrier, moment, wanted)
    # The stamp lies on the mesh and not in this module, so that undo and reload take it back with the positions.
    if mesh.get(names.STAMP_PROPERTY) == stamp:
        return
    check_fits(obj, loaded)
    start = time.perf_counter()
    rows = rows_of(mesh)
    if placement.follow_live(obj, loaded.source, rows):
        print(f"AdaAnchor4D: {obj.name}: points that were moved by hand are back where the model has them.")
    matrix = placement.map_of(mesh)
    if matrix is not None:
        moment = moment_of(obj, loaded, scene, depsgraph)  # seen from elsewhere, where the map is new
        stamp = _stamp(loaded, carrier, moment, wanted)
    together |= wanted
    plain, center = together.difference(names.HARMONICS), np.array(moment.center)
    evaluation = f"{carrier} {moment.t!r} {moment.center} {sorted(a.name for a in plain)} "
    kept = f"{evaluation}{moment.quick} {len(together - plain)}"
    frame = loaded.frame(kept, carrier, moment.t, center, together, moment.quick)
    if len(together) > len(plain):
        color_errors[obj.session_uid] = loaded.color_errors(kept, moment.t, center)
    played = None if moment.quick else loaded.frames.get(f"{evaluation}{True} 0")
    if played is not None:  # the timeline has just come to rest here
        off = np.linalg.norm(played[names.POSITION] - frame[names.POSITION], axis=1)[frame[names.OPACITY] > 0]
        quick_errors_m[obj.session_uid] = float(np.percentile(off, QUICK_SHARE)) if len(off) else 0.0
    values = {a: array[rows] for a, array in frame.items() if a in names.APPEARANCE or a in wanted}
    if matrix is not None:
        values = affine.moved(values, matrix)
    for attribute, array in values.items():
        points.write(mesh, attribute.name, attribute.type, array)
    for age in range(1, moment.trail + 1):
        before = loaded.trail(carrier, max(int(moment.rank) - age, 0))[rows]
        before = before if matrix is None else affine.moved_places(before, matrix)
        points.write(mesh, names.trail_name(age), "FLOAT_VECTOR", before)
    placement.remember(mesh, moment.t)
    mesh[names.STAMP_PROPERTY] = stamp
    mesh.update()
    milliseconds[obj.session_uid] = 1000 * (time.perf_counter() - start)


def _stamp(loaded: Loaded, carrier: str, moment: Moment, wanted: frozenset[names.Attribute]) -> str:
    """What tells apart two states of a mesh."""
    shown = f"{moment.t!r} {moment.center} {moment.trail} {moment.quick}"
    return f"{loaded.content} {carrier} {shown} {sorted(a.name for a in wanted)}"


def rows_of(mesh: bpy.types.Mesh) -> slice | np.ndarray:
    """The rows of the model that the vertices show; all of them as a slice, which copies nothing."""
    rows = points.ids(mesh)
    whole = len(rows) > 0 and rows[0] == 0 and rows[-1] == len(rows) - 1 and bool((np.diff(rows) == 1).all())
    return slice(0, len(rows)) if whole else rows


def trail_length(obj: bpy.types.Object) -> int:
    """How many ghosts the object shows."""
    modifier = modifiers.of(obj, names.TIME_MODIFIER)
    return 0 if modifier is None else modifiers.get(modifier, time_nodes.TRAIL)


def is_ours(obj: bpy.types.Object) -> bool:
    """Whether the object's points can be changed here: those of another file's objects cannot."""
    return obj.library is None and obj.data.library is None


def live_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The scene's objects that are evaluated here, also those that it only shows as instances of a collection.

    Not in edit mode, where the mesh belongs to the person.
    """
    found = dict.fromkeys(scene.objects)
    for obj in scene.objects:
        if obj.instance_type == "COLLECTION" and obj.instance_collection is not None:
            found |= dict.fromkeys(obj.instance_collection.all_objects)
    live = [obj for obj in found if parts.is_imported(obj) and obj.aa4d.playback == "LIVE"]
    return [obj for obj in live if not obj.data.is_editmode]  # the mode of the object is not that of its duplicates


@bpy.app.handlers.persistent
def refresh(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph | None = None) -> None:
    """Bring every live object of the scene to the current frame.

    Called after a change of frame, of sub-frame too (motion blur), when animation and drivers have been evaluated, and
    after any other change, for the inputs of the modifiers.
    """
    if depsgraph is not None:
        for update in depsgraph.updates:
            if isinstance(update.id, bpy.types.Mesh) and update.id.original.library is None:
                _follow_baked(update.id.original)
    alone = [obj for obj in scene.objects if parts.is_imported(obj) and obj.parent is None and obj.library is None]
    orphans = [obj for obj in alone if parts.keep_time(obj)]
    if orphans:
        depsgraph = None  # its copies do not have the time yet that was just given back
    with modifiers.unchanged_groups():
        _show_all(live_objects(scene), scene, depsgraph)


def _show_all(live: list[bpy.types.Object], scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph | None) -> None:
    """Bring these objects to the current frame; what is wrong with one is said and leaves the others alone."""
    for obj in live:
        if not is_ours(obj):
            _say(obj, STANDS_STILL)
    live = [obj for obj in live if is_ours(obj)]
    wanted = {obj: wanted_of(obj if depsgraph is None else obj.evaluated_get(depsgraph)) for obj in live}
    together: dict[tuple[str, str], frozenset[names.Attribute]] = {}
    for obj in live:
        key = parts.key_of(obj)
        together[key] = together.get(key, frozenset()) | wanted[obj]
    found: dict[tuple[str, ...], Loaded] = {}
    for users in _users_of_meshes(live):
        needed = frozenset().union(*(wanted[obj] for obj in users))
        for obj in users:
            try:
                if obj != users[0]:
                    _separate(obj, users[0], scene, depsgraph)
                    if obj.data == users[0].data:
                        problems.pop(obj.session_uid, None)
                        continue
                link = (obj.aa4d.filepath, obj.aa4d.last_place, obj.aa4d.content)
                if link not in found:  # once for all objects of an import: it asks for the file
                    found[link] = loaded_of(obj)
                show(obj, scene, depsgraph, needed, together[parts.key_of(obj)], found[link])
                problems.pop(obj.session_uid, None)
            except (ModelFileError, MemoryError) as error:
                _say(obj, str(error) or "there is not enough memory for this frame.")


def _say(obj: bpy.types.Object, message: str) -> None:
    """A handler has no report line: say it once on the console, and in the panel while it lasts."""
    if message not in (problems.get(obj.session_uid), problems.get(parts.lead(obj).session_uid)):
        print(f"AdaAnchor4D: {obj.name}: {message}")
    problems[obj.session_uid] = message


def _users_of_meshes(objects: Iterable[bpy.types.Object]) -> list[list[bpy.types.Object]]:
    """The objects, those together that share a mesh."""
    users: dict[bpy.types.Mesh, list[bpy.types.Object]] = {}
    for obj in objects:
        users.setdefault(obj.data, []).append(obj)
    return list(users.values())


def _separate(
    obj: bpy.types.Object, first: bpy.types.Object, scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph | None
) -> None:
    """Give a linked duplicate points of its own once it is to show something else: a mesh has one time and one view.

    Raises:
        ModelFileError: as `loaded_of`.
    """
    moments = [(parts.key_of(o), moment_of(o, loaded_of(o), scene, depsgraph)) for o in (obj, first)]
    if moments[0] != moments[1]:
        parts.make_own([obj])


def _follow_baked(mesh: bpy.types.Mesh) -> None:
    """Keep what a person did to the points of a baked mesh."""
    if not placement.has_keys(mesh):
        return
    users = [obj for obj in bpy.data.objects if obj.data == mesh]
    if users and not mesh.is_editmode and all(obj.aa4d.playback == "BAKED" for obj in users):
        placement.follow_baked(mesh)


@bpy.app.handlers.persistent
def keep_paths(filepath: str, _: object = None) -> None:
    """Before the file is saved: make the paths of the models relative to where it will lie, where that is possible."""
    for obj in bpy.data.objects:
        if obj.type == "MESH" and obj.aa4d.filepath and obj.library is None:
            path = os.path.normpath(bpy.path.abspath(obj.aa4d.filepath))
            if not os.path.isfile(path) and os.path.isfile(obj.aa4d.last_place):
                path = obj.aa4d.last_place
            if os.path.isfile(path):
                obj.aa4d.last_place = path
                if filepath:
                    obj.aa4d.filepath = relative(path, os.path.dirname(filepath))


def relative(path: str, folder: str) -> str:
    """A path as seen from a folder, in Blender's notation; itself on another drive."""
    try:
        return bpy.path.relpath(path, start=folder)
    except ValueError:
        return path


LISTENERS = (
    (bpy.app.handlers.frame_change_post, refresh),
    (bpy.app.handlers.depsgraph_update_post, refresh),
    (bpy.app.handlers.animation_playback_post, refresh),
    (bpy.app.handlers.save_pre, keep_paths),
)


def register() -> None:
    """Start listening."""
    for handlers, function in LISTENERS:
        handlers.append(function)


def unregister() -> None:
    """Stop listening, and forget the models."""
    for handlers, function in LISTENERS:
        handlers.remove(function)
    _load.cache_clear()
    parts.forget_times()
    modifiers.forget()
    milliseconds.clear()
    quick_errors_m.clear()
    color_errors.clear()
    problems.clear()
