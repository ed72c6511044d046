"""Streets and city: the ground agrees with the lanes, and the same seed builds the same place."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from synth.city.blocks import BLOCKS
from synth.city.layout import build_city
from synth.city.surfaces import SURFACES
from synth.city.vehicles import vehicle_mesh
from synth.plan import document, make_fleet, make_plan
from synth.spec import Block, read_scene
from synth.streets import STREETS, UNLIT
from synth.streets.ground import Island
from synth.traffic import off_road
from synth.traffic.fleet import BODIES

ROOT = Path(__file__).resolve().parents[2]
Array = NDArray[np.float64]


def inside(points: Array, island: Island) -> NDArray[np.bool_]:
    """Which of the points [N, 2] lie on an island."""
    return off_road.inside(points, np.array([*island.kerb.outline(3.0), *island.beyond]))


@pytest.mark.parametrize("kind", STREETS)
@pytest.mark.parametrize("signals", [False, True])
def test_lanes_run_on_the_road_and_people_walk_beside_it(kind: str, signals: bool) -> None:
    if signals and kind in UNLIT:
        pytest.skip("has no lights")
    street = STREETS[kind]()
    network, ground = street.network(signals), street.ground(signals)
    for name, lane in network.lanes.items():
        if lane.level_m > 0:
            continue
        s = np.linspace(0, lane.path.length_m, max(2, int(lane.path.length_m / 0.5)))
        for side in (-0.95, 0.95):  # half the width of a car
            points = lane.path.beside(s, np.full(len(s), side))
            for island in ground.islands:
                assert not inside(points, island).any(), (kind, name)
    for crossing in network.crossings:
        middle = 0.5 * (np.array(crossing.start) + crossing.end)
        ends = np.array([crossing.start, crossing.end])
        beyond = ends + 0.3 * (ends - middle) / np.linalg.norm(ends - middle, axis=1, keepdims=True)
        assert all(any(inside(end[None], island)[0] for island in ground.islands) for end in beyond), kind
    for path in network.walks:
        points = path.points(np.linspace(1, path.length_m - 1, 50))
        assert np.any([inside(points, island) for island in ground.islands], axis=0).all(), kind
    for bay in network.bays:
        assert not any(inside(np.array([bay.pose[:2]]), island)[0] for island in ground.islands), kind


@pytest.mark.parametrize("kind", BLOCKS)
def test_blocks_stay_behind_the_pavement_and_use_known_surfaces(kind: str) -> None:
    for street in (STREETS["crossroads"](), STREETS["car-park"]()):
        ground = street.ground(False)
        blocks = (Block(corner="north-west", kind=kind), Block(corner="south-east", kind=kind, floors=(1, 2)))
        city = build_city(ground, blocks, 0.5, seed=4)
        assert set(city.static.surfaces) <= SURFACES.keys()
        assert {surface for mesh in city.props.values() for surface in mesh.surfaces} <= SURFACES.keys()
        vertices = np.array(city.static.vertices)
        tall = np.unique(
            np.round(vertices[(vertices[:, 2] > 1.0) & (np.abs(vertices[:, :2]).max(axis=1) < 90), :2]), axis=0
        )
        lanes = street.network(False).lanes.values()
        points = np.unique(np.round(np.concatenate([lane.path.points(np.arange(0, lane.path.length_m, 1.0))
                                                    for lane in lanes])), axis=0)  # fmt: skip
        if len(tall):  # nothing tall stands in the way
            nearest = min(float(np.hypot(*(tall - point).T).min()) for point in points)
            assert nearest > 2.0, (kind, street.kind)


def test_meshes_of_road_users_fit_their_boxes() -> None:
    for kind, body in BODIES.items():
        mesh = vehicle_mesh(kind)
        vertices = np.array(mesh.vertices)
        assert set(mesh.surfaces) <= SURFACES.keys()
        assert vertices[:, 2].min() == pytest.approx(0.0, abs=0.06), kind
        assert vertices[:, 2].max() < body.height_m + 0.03, kind
        assert np.abs(vertices[:, 0]).max() < body.length_m / 2 + 0.03, kind
        assert np.abs(vertices[:, 1]).max() < body.width_m / 2 + 0.03, kind
        assert np.ptp(vertices[:, 0]) > 0.85 * body.length_m, kind
        assert vertices[:, 2].max() > 0.95 * body.height_m, kind


def test_same_seed_same_place_other_seed_other_place() -> None:
    scene = replace(read_scene(ROOT / "scenes" / "tiny.toml"), vehicles=(), signal=None)
    once, again = (document(make_plan(scene), "x") for _ in range(2))
    assert once == again
    other = document(make_plan(replace(scene, seed=scene.seed + 1)), "x")
    assert other["city_sha256"] != once["city_sha256"]


def test_a_single_frame_makes_a_plan() -> None:
    scene = read_scene(ROOT / "scenes" / "tiny.toml")
    plan = make_plan(replace(scene, time=replace(scene.time, frames=1)))
    assert [frame.t for frame in plan.frames] == [0.0]
    assert np.isfinite(plan.frames[0].viewmat).all()
    assert np.isfinite(plan.fleet.object_to_world(0.0)).all()
    assert np.isfinite(plan.fleet.object_to_world(0.4)).all()  # as a long exposure asks


def test_arc_scenes_are_full_of_life() -> None:
    """One dense and one quiet scene: every activity class of motion is there, near what the camera looks at."""
    for name, least in (("arc07", 20), ("arc04", 4)):
        scene = read_scene(ROOT / "scenes" / f"{name}.toml")
        duration = (scene.time.frames - 1) / scene.time.fps
        fleet = make_fleet(scene, duration)
        times = np.linspace(0, duration, 17)
        moving = np.array([fleet.moving(float(t)) for t in times])
        near = np.hypot(*fleet.object_to_world(0.0)[:, :2, 3].T) < 60
        assert (moving[:, near].any(axis=0)).sum() >= least, name  # moves
        assert (~moving[:, near].any(axis=0)).sum() >= 4, name  # stands
        assert (moving[:, near].any(axis=0) & ~moving[:, near].all(axis=0)).sum() >= 1, name  # starts or stops
