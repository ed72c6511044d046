"""The plan: a scene with every number resolved, before anything is rendered."""

import dataclasses
import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from synth import __version__
from synth.camera import intrinsics, invert_rigid
from synth.cast import Cast
from synth.city.land import land, looks_beyond
from synth.city.layout import City, build_city
from synth.effects import Effect, at, choose
from synth.errors import InputError
from synth.flight import Flight, Trajectory
from synth.lens import Lens, Pinhole
from synth.models import Model, find_models
from synth.seeds import frame_seed
from synth.shutter import Shutter
from synth.spec import Scene
from synth.staging import Staging
from synth.streets.ground import BEYOND_M
from synth.traffic.instances import Fleet, build_fleet
from synth.traffic.off_road import off_road_share
from synth.traffic.tracks import read_tracks

Array = NDArray[np.float64]

Drone = Literal["first", "second"]
TEST_EVERY = 8  # docs/formats.md: ranks 0, 8, 16, ... are held out


@dataclass(frozen=True)
class Frame:
    """One instant of the clip."""

    rank: int
    name: str
    time_s: float
    t: float
    split: Literal["train", "test"]
    seed: int
    viewmat: Array  # [4, 4]


@dataclass(frozen=True)
class Plan:
    """Everything that the renderer and the exporters need."""

    scene: Scene
    K: Array  # [3, 3]
    frames: tuple[Frame, ...]
    flight: Any  # camera_to_world(time_s) and viewmat(time_s) at any real time
    fleet: Fleet
    city: City
    effects: tuple[Effect, ...]
    lens: Lens
    shutter: Shutter
    staging: tuple[Staging, ...]
    cast: Cast  # the fleet and what effects add to it
    models: tuple[Model, ...] = ()  # of the user's own
    drone: Drone = "first"

    def film_effects(self) -> Iterator[Effect]:
        """Those that act on the light of a frame."""
        return at(self.effects, "film")


def make_plan(scene: Scene, folder: Path = Path(), drone: Drone = "first") -> Plan:
    """Resolve a scene, as one of its drones films it; `folder` is where the files that it names are looked up.

    Both drones see the same world at the same times; the second one's poses are the true ones, and all of its frames
    are held out.

    Raises:
        InputError: the traffic collides, effects ask for what cannot be, or there is no second drone.
    """
    count, fps = scene.time.frames, scene.time.fps
    effects = choose(scene.effects, "the scene")
    flights = [_flown(flight, scene, effects) for flight in (scene.flight, scene.second_flight) if flight is not None]
    if drone == "second":
        if scene.second_flight is None:
            raise InputError("second_flight: missing; the second drone needs a flight.")
        effects = tuple(effect for effect in effects if effect.stage != "capture")
    flight, duration = flights[drone == "second"], (count - 1) / fps
    frames = tuple(
        Frame(
            rank=k,
            name=f"{k:06d}",
            time_s=k / fps,
            t=k / (count - 1) if count > 1 else 0.0,
            split="test" if k % TEST_EVERY == 0 or drone == "second" else "train",
            seed=frame_seed(scene.seed, k),
            viewmat=flight.viewmat(k / fps),
        )
        for k in range(count)
    )
    K, size = intrinsics(scene.camera), (scene.camera.width_px, scene.camera.height_px)
    lens: Lens = Pinhole(K)
    for effect in at(effects, "lens"):
        if not isinstance(lens, Pinhole):
            raise InputError(f"effects: {effect.name} is a second lens; a camera has one: leave one of them out.")
        lens = effect.module.lens(effect.settings, K, size)
    shutter = Shutter()
    for effect in at(effects, "shutter"):
        shutter = effect.module.shut(effect.settings, shutter, fps)
    if shutter.readout_s > 0 and any(lens.margin_px):
        raise InputError(
            "effects: rolling_shutter and lens_distortion together are not simulated: a bent row has no single pose; "
            "name one of them."
        )
    signals = scene.signal is not None
    city = build_city(scene.street.ground(signals), scene.blocks, scene.greenery.street_trees, scene.seed)
    poses = np.stack([each.viewmat(t) for each in flights for frame in frames for t in shutter.span_s(frame.time_s)])
    if looks_beyond(poses, K, size, lens.margin_px):
        highest = float(invert_rigid(poses)[:, 2, 3].max())
        city = dataclasses.replace(city, land=land(highest, 1 / K[0, 0]))
    fleet = make_fleet(scene, duration, folder)
    models = find_models(scene.assets, folder)
    plan = Plan(scene, K, frames, flight, fleet, city, effects, lens, shutter, (), Cast(fleet), models, drone)
    for effect in at(effects, "scene"):
        plan = _staged(plan, effect.module.stage(effect.settings, plan))
    return plan


def _flown(flight: Flight, scene: Scene, effects: tuple[Effect, ...]) -> Any:
    """A flight as it is flown: `Plan.flight`."""
    flown: Any = Trajectory(flight, (scene.time.frames - 1) / scene.time.fps)
    for effect in at(effects, "pose"):
        flown = effect.module.fly(effect.settings, flown, scene.seed)
    return flown


def _staged(plan: Plan, staging: Staging) -> Plan:
    """The plan with one more effect on stage."""
    extras = staging.extras()
    cast = plan.cast if extras is None else Cast(plan.fleet, (*plan.cast.extras, extras))
    return dataclasses.replace(plan, city=staging.city(plan.city), staging=(*plan.staging, staging), cast=cast)


def make_fleet(scene: Scene, duration_s: float, folder: Path = Path()) -> Fleet:
    """Everybody who drives, walks or stands in a scene, over its clip.

    Raises:
        InputError: two vehicles overlap, or the scene asks for what the street does not have.
    """
    lights = None
    if scene.signal is not None:
        lights = {"east_west": scene.signal.east_west_green_s, "north_south": scene.signal.north_south_green_s}
    tracks = read_tracks(scene.tracks, folder, duration_s) if scene.tracks else None
    fleet = build_fleet(
        scene.street.network(lights is not None), scene.vehicles, scene.flows, scene.traffic, scene.parking,
        scene.pedestrians, lights, scene.seed, duration_s, tracks,
    )  # fmt: skip
    if tracks is not None:
        islands = scene.street.ground(lights is not None).islands
        raised = [np.array([*island.kerb.outline(3.0), *island.beyond]) for island in islands]
        share = off_road_share(tracks, raised, BEYOND_M, duration_s)
        note = f"tracks: {share:.1%} of the vehicles' way lies off the road"
        place = (
            "; tracks.recentre, scale, turn_deg and shift_m place the table on the street." if share > 0.005 else "."
        )
        fleet = dataclasses.replace(fleet, notes=(*fleet.notes, note + place))
    return fleet


def document(plan: Plan, blender: str) -> dict[str, Any]:
    """The plan as JSON: what identifies a capture folder. Two equal documents render the same bytes.

    Meshes and trajectories enter by their SHA-256, `blender` is the version that renders.
    """
    poses = np.stack([plan.cast.object_to_world(frame.time_s) for frame in plan.frames])
    content: dict[str, Any] = {
        "format": "aa4d-synth-plan",
        "version": 1,
        "generator": {"program": "aa4d synth", "version": __version__, "blender": blender},
        "scene": dataclasses.asdict(plan.scene),
        "K": plan.K.tolist(),
        "frames": [{**dataclasses.asdict(frame), "viewmat": frame.viewmat.tolist()} for frame in plan.frames],
        "effects": {effect.name: dataclasses.asdict(effect.settings) for effect in plan.effects},
        "instances": [dataclasses.asdict(instance) for instance in plan.fleet.instances],
        "extras": [dataclasses.asdict(member) for member in plan.cast.members()[len(plan.fleet.instances) :]],
        "trajectories_sha256": hashlib.sha256(poses.tobytes()).hexdigest(),
        "city_sha256": plan.city.digest(),
        "models": {model.kind: model.sha256 for model in plan.models},
    }
    if plan.scene.second_flight is None:
        del content["scene"]["second_flight"]  # of a scene without one the document is as it always was
    else:
        content["drone"] = plan.drone
    content = json.loads(json.dumps(content))  # tuples become lists, as in a document read back
    content["sha256"] = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    return content


def first_difference(here: Any, there: Any, key: str = "") -> str | None:
    """The first key in which two plans differ with both values, in words; None when they agree."""
    if isinstance(here, dict) and isinstance(there, dict):
        for name in here:
            if name not in there:
                return f"{key}{name} is absent there"
            if name != "sha256" and (found := first_difference(here[name], there[name], f"{key}{name}.")):
                return found
        return None
    if isinstance(here, list) and isinstance(there, list) and len(here) == len(there):
        pairs = enumerate(zip(here, there, strict=True))
        return next((f for i, (a, b) in pairs if (f := first_difference(a, b, f"{key}{i}."))), None)
    if here == there:
        return None
    short = all(len(json.dumps(value)) < 60 for value in (here, there))
    name = key.removesuffix(".")
    return f"{name} is {json.dumps(there)} there and {json.dumps(here)} here" if short else f"{name} differs"
