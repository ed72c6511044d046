"""Traffic: lanes, car following, signals, parked vehicles, and poses at any real time."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from synth.errors import InputError
from synth.plan import Plan, make_fleet, make_plan
from synth.spec import Flow, Parking, Pedestrians, Scene, Signal, Traffic, Vehicle, read_scene
from synth.streets import STREETS
from synth.streets.crossroads import Crossroads
from synth.traffic.fleet import BODIES
from synth.traffic.following import ballistic, idm_acceleration, within_gap
from synth.traffic.instances import Fleet, Instance, Standing, amend, overlapping, overlaps
from synth.traffic.network import RUN_UP_M, Network, joints
from synth.traffic.population import Amends, Parked, populate
from synth.traffic.simulation import Drives, simulate

ROOT = Path(__file__).resolve().parents[2]
STREET = Crossroads(arm_m=80.0)
NETWORK = STREET.network(signals=True)


@pytest.fixture(scope="module")
def scene() -> Scene:
    return read_scene(ROOT / "scenes" / "crossroads.toml")


@pytest.fixture(scope="module")
def plan(scene: Scene) -> Plan:
    return make_plan(scene)


def drive(*vehicles: Vehicle, signal: Signal | None = None, traffic: Traffic | None = None, until: float = 20,
          network: Network = NETWORK) -> Drives:  # fmt: skip
    traffic = traffic or Traffic(parked_share=0.0)
    population = populate(network, vehicles, (), traffic, Parking(), Pedestrians(), 0, until)
    lights = None
    if signal is not None:
        lights = {"east_west": signal.east_west_green_s, "north_south": signal.north_south_green_s}
    return simulate(network, population.cars, (), lights, traffic, 0.0, until)


def test_routes_join_without_gaps_or_kinks() -> None:
    for kind, street in STREETS.items():
        for signals in (False, True):
            network = street().network(signals)
            assert network.routes, kind
            for route in network.routes:
                assert np.abs(joints(network.route_path(route))).max() < 1e-9, (kind, route)
    assert len(NETWORK.routes) == 12


def test_routes_keep_right_and_end_on_their_arm() -> None:
    start, end = NETWORK.route_path("west-north").points(np.array([0.0, NETWORK.route_path("west-north").length_m]))
    np.testing.assert_allclose(start, [-STREET.arm_m, -STREET.lane_width_m / 2], atol=1e-9)
    np.testing.assert_allclose(end, [STREET.lane_width_m / 2, STREET.arm_m], atol=1e-9)


def test_paths_are_parameterised_by_arc_length() -> None:
    for route in NETWORK.routes:
        path = NETWORK.route_path(route)
        points = path.points(np.linspace(-5, path.length_m + 5, 20_001))
        steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
        np.testing.assert_allclose(steps, steps[0], rtol=1e-5)


def test_poses_are_smooth_along_a_turn() -> None:
    path = NETWORK.route_path("east-north")
    s = np.linspace(0, path.length_m, 4000)
    _, heading = path.axle_pose(s, 2.6)
    turn = np.diff(np.unwrap(heading)) / np.diff(s)
    assert np.abs(turn).max() < 1 / 5  # radius never under five metres
    assert np.abs(np.diff(turn)).max() < 0.01  # no jump of the steering
    np.testing.assert_allclose(abs(heading[-1]), math.pi / 2, atol=1e-9)


def test_no_two_vehicles_overlap_in_the_shipped_scene(plan: Plan) -> None:
    for time_s in np.linspace(0, plan.frames[-1].time_s, 97):
        assert overlapping(plan.fleet, float(time_s)) == []


def test_shipped_scene_has_several_moving_and_one_that_stops_and_goes(plan: Plan) -> None:
    speeds = np.array([plan.fleet.speed_mps(frame.time_s) for frame in plan.frames])
    assert ((speeds > 0.05).sum(axis=1) >= 4).all()
    stands = speeds[:, : len(plan.scene.vehicles)] <= 0.05
    waits_then_goes = stands.any(axis=0) & (speeds[0, : stands.shape[1]] > 2) & (speeds[-1, : stands.shape[1]] > 2)
    assert waits_then_goes.any()


def test_stops_at_the_red_light_and_goes_on_green() -> None:
    signal = Signal(east_west_green_s=((12.0, 99.0),), north_south_green_s=())
    drives = drive(Vehicle(route="west-east", position_m=-40, speed_mps=10), signal=signal)
    line = NETWORK.stop_line_m("west-east")
    waiting = drives.state(11.0)
    assert waiting[1][0] == 0.0
    front = waiting[0][0] + 4.65 / 2
    assert line - 1.0 < front < line
    assert drives.state(18.0)[1][0] > 5.0


def test_heading_is_kept_at_speed_zero() -> None:
    signal = Signal(east_west_green_s=(), north_south_green_s=())
    drives = drive(Vehicle(route="west-east", position_m=-20, speed_mps=8), signal=signal)
    assert drives.state(15.0)[1][0] == 0.0
    assert drives.poses(15.0)[1][0] == drives.poses(19.0)[1][0] == pytest.approx(0.0, abs=1e-12)


def test_too_late_to_stop_drives_through() -> None:
    signal = Signal(east_west_green_s=((-9.0, 0.5),), north_south_green_s=())
    drives = drive(Vehicle(route="west-east", position_m=-9, speed_mps=12, cruise_mps=12), signal=signal)
    assert drives.speed_mps.min() > 8


def test_followers_never_touch_and_never_reverse() -> None:
    signal = Signal(east_west_green_s=((8.0, 99.0),), north_south_green_s=())
    queue = [Vehicle(route="west-east", position_m=-15 - 12 * k, speed_mps=12, cruise_mps=14) for k in range(5)]
    drives = drive(*queue, signal=signal)
    gaps = drives.position_m[:, :-1] - drives.position_m[:, 1:] - 4.65
    assert gaps.min() > 0.3
    assert drives.speed_mps.min() >= 0
    assert np.all(np.diff(drives.position_m, axis=0) >= 0)


def test_state_between_steps_is_continuous() -> None:
    signal = Signal(east_west_green_s=(), north_south_green_s=())
    drives = drive(Vehicle(route="west-east", position_m=-20, speed_mps=8), signal=signal, traffic=Traffic(step_s=0.1))
    for time_s in drives.times_s[1:-1]:
        before, after = drives.state(time_s - 1e-9), drives.state(time_s + 1e-9)
        np.testing.assert_allclose(before, after, atol=1e-6)


def test_empty_traffic(scene: Scene) -> None:
    empty = replace(scene, vehicles=(), traffic=Traffic(parked_share=0.0))
    fleet = make_fleet(empty, 4.0)
    assert fleet.object_to_world(1.0).shape == (0, 4, 4)
    assert fleet.speed_mps(1.0).shape == fleet.moving(1.0).shape == (0,)


def test_overlap_is_refused(scene: Scene) -> None:
    same = Vehicle(route="west-east", position_m=-20.0, speed_mps=9)
    with pytest.raises(InputError, match="inside the vehicle ahead"):
        make_fleet(replace(scene, vehicles=(same, replace(same, position_m=-18.0))), 2.0)
    across = Vehicle(route="south-north", position_m=12.0, speed_mps=0.5, cruise_mps=0.5)
    through = Vehicle(route="west-east", position_m=0.0, speed_mps=9.0)
    with pytest.raises(InputError, match="overlap at"):
        make_fleet(replace(scene, vehicles=(across, through), signal=None), 3.0)


def test_parked_vehicles_do_not_depend_on_the_driven_ones(scene: Scene) -> None:
    with_traffic, without = make_fleet(scene, 1.0), make_fleet(replace(scene, vehicles=()), 1.0)
    assert with_traffic.groups[-1] == without.groups[-1]


# Hard cases of car following.


def test_within_gap_changes_nothing_at_fine_steps() -> None:
    """IDM drives safely by itself: a follower of a leader that brakes to a stop is never touched by the guard."""
    traffic = Traffic(step_s=0.02)
    leader_position, leader_speed = np.array([40.0]), np.array([14.0])
    position, speed = np.array([0.0]), np.array([14.0])
    for step in range(1500):
        gap = leader_position - position
        free = idm_acceleration(speed, np.array([15.0]), gap, speed - leader_speed, traffic)
        np.testing.assert_array_equal(within_gap(free, speed, gap, leader_speed, 0.02), free)
        position, speed = ballistic(position, speed, free, 0.02)
        braking = np.array([-4.0 if 200 < step < 500 else 0.0])
        leader_position, leader_speed = ballistic(leader_position, leader_speed, braking, 0.02)
    assert 0.5 < (leader_position - position)[0] < 4.0


@pytest.mark.parametrize("step_s", [0.05, 1.0])
def test_queue_at_a_coarse_step_stays_in_order(step_s: float) -> None:
    signal = Signal(east_west_green_s=((8.0, 99.0),), north_south_green_s=())
    queue = [Vehicle(route="west-east", position_m=-30 - 14 * k, speed_mps=14, cruise_mps=14) for k in range(4)]
    drives = drive(*queue, signal=signal, traffic=Traffic(step_s=step_s, parked_share=0.0))
    gaps = drives.position_m[:, :-1] - drives.position_m[:, 1:] - BODIES["saloon"].length_m
    assert gaps.min() > 0
    assert drives.speed_mps.min() >= 0
    assert np.isfinite(drives.position_m).all()


def test_halving_the_step_halves_the_error() -> None:
    """Behind a slow leader, without decisions that may fall differently: first order in the step."""
    platoon = [Vehicle(route="west-east", position_m=20.0, speed_mps=6.0, cruise_mps=6.0)]
    platoon += [
        Vehicle(route="west-east", position_m=-25.0 - 20 * k, speed_mps=13.0, cruise_mps=13.0) for k in range(3)
    ]
    at = [drive(*platoon, traffic=Traffic(step_s=s, parked_share=0.0)).state(9.0)[0] for s in (0.4, 0.2, 0.01)]
    coarse, middle = (float(np.abs(p - at[2]).max()) for p in at[:2])
    assert middle < 0.6 * coarse
    assert coarse < 0.5


# Right of way, lane changes, parking, people.


@pytest.mark.parametrize("route", ["west-east", "west-north"])
def test_a_vehicle_starts_on_its_road_up_to_both_of_its_ends(route: str) -> None:
    length, line = NETWORK.route_path(route).length_m, NETWORK.stop_line_m(route)
    first, last = math.ceil(-RUN_UP_M - line), math.floor(length + RUN_UP_M - line)
    for position in (first, last):
        drives = drive(Vehicle(route=route, position_m=position, speed_mps=0.0), until=0.1)
        assert abs(drives.poses(0.0)[0]).max() < STREET.arm_m + RUN_UP_M + BODIES["saloon"].length_m
    for position in (-2000.0, first - 1.0, last + 1.0):
        with pytest.raises(InputError) as refused:
            drive(Vehicle(route=route, position_m=position, speed_mps=0.0))
        assert str(refused.value).startswith(
            f"vehicles[0].position_m: {position:g} is off the road of {route}; it must"
        )
        assert f"from {first} to {last}" in str(refused.value)


def test_who_turns_left_gives_way() -> None:
    """Without the rule the turn would cross the path of the vehicle that comes straight on."""
    left = Vehicle(route="west-north", position_m=-14.0, speed_mps=8.0)
    straight = Vehicle(route="east-west", position_m=-16.0, speed_mps=9.0)
    drives = drive(left, straight, network=STREET.network(signals=False), until=14.0)
    fleet = Fleet(tuple(Instance(n, "x", "saloon", (0, 0, 0)) for n in (1, 2)), (drives,))
    assert all(not overlapping(fleet, float(t)) for t in np.linspace(0, 14, 141))
    assert drives.speed_mps[:, 0].min() < 1.0  # waited
    assert drives.speed_mps[:, 1].min() > 7.0  # did not have to
    assert drives.position_m[-1, 0] > NETWORK.stop_line_m("west-north") + 20  # and went on


def test_lane_changes_are_smooth_and_lead_past_slow_traffic() -> None:
    network = STREETS["straight"](lanes=2, arm_m=400.0, crossing=False, parking_width_m=0.0).network(signals=False)
    slow = Vehicle(route="west-east/0", position_m=-290.0, speed_mps=5.0, cruise_mps=5.0)
    fast = Vehicle(route="west-east/0", position_m=-395.0, speed_mps=13.0, cruise_mps=14.0)
    drives = drive(slow, fast, network=network, until=30.0)
    assert len(np.unique(drives.path_of[:, 1])) == 2
    poses = [drives.poses(float(t)) for t in np.arange(0, 30, 0.01)]
    centres, headings = np.array([p[0][1] for p in poses]), np.array([p[1][1] for p in poses])
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    assert steps.max() < 14.5 * 0.01  # never a jump sideways
    assert np.abs(np.diff(headings)).max() < math.radians(0.3)
    assert np.abs(np.diff(headings, 2)).max() < math.radians(0.05)
    assert np.abs(headings).max() < math.radians(15)
    assert centres[-1, 0] > np.array([drives.poses(29.99)[0][0]])[0, 0]  # got past
    fleet = Fleet(tuple(Instance(n, "x", "saloon", (0, 0, 0)) for n in (1, 2)), (drives,))
    assert all(not overlapping(fleet, float(t)) for t in np.linspace(0, 29, 291))


def test_parked_vehicles_leave_and_others_arrive(scene: Scene) -> None:
    quiet = replace(scene, vehicles=(), signal=None, traffic=Traffic(step_s=0.05))
    busy = replace(quiet, parking=Parking(leaving=2, arriving=3))
    fleet = make_fleet(busy, 24.0)
    speeds = np.array([fleet.speed_mps(t) for t in np.linspace(0, 24, 121)])
    names = [instance.name for instance in fleet.instances]
    leaving = [m for m, name in enumerate(names) if name.startswith("leaving")]
    arriving = [m for m, name in enumerate(names) if name.startswith("arriving")]
    assert (len(leaving), len(arriving)) == (2, 3)
    assert (speeds[0, leaving] == 0).all()
    assert (speeds[:, leaving].max(axis=0) > 5).all()
    assert (speeds[:, arriving].max(axis=0) > 5).all()
    parked = [m for m in arriving if speeds[-1, m] == 0]
    assert len(parked) >= 2  # the others are still on their way when the clip ends
    kerb = STREET.ground(False).plots  # behind the pavement: nobody parks there
    for m in parked:
        x, y = np.abs(fleet.object_to_world(24.0)[m, :2, 3])
        assert 3.2 < min(x, y) < abs(kerb["north-east"][0]) - 3.0


def test_people_cross_when_vehicles_may_not(scene: Scene) -> None:
    """Nobody is on a crossing together with a vehicle: the overlap check of the fleet would refuse it."""
    crowd = replace(scene, pedestrians=Pedestrians(crossing=20, strolling=4), flows=(Flow(per_hour=500),), vehicles=(),
                    traffic=Traffic(step_s=0.1, warm_up_s=30.0))  # fmt: skip
    fleet = make_fleet(crowd, 8.0)
    people = [m for m, instance in enumerate(fleet.instances) if instance.kind == "pedestrian"]
    assert len(people) == 24
    heights = np.array([fleet.object_to_world(t)[people, 2, 3] for t in np.linspace(0, 8, 33)])
    assert heights.max() == 0.12
    assert heights.min() == 0.0  # someone is on the road


def test_every_street_carries_traffic_without_overlaps() -> None:
    """`make_fleet` refuses overlaps: a minute of dense flow on every street, simulated for some seconds of clip."""
    for kind, street in STREETS.items():
        table = read_scene(ROOT / "scenes" / "tiny.toml")
        dense = replace(table, street=street(), signal=None, vehicles=(), flows=(Flow(per_hour=500, turning=0.4),),
                        traffic=Traffic(step_s=0.1, warm_up_s=40.0), blocks=())  # fmt: skip
        fleet = make_fleet(dense, 6.0)
        moving = np.array([fleet.moving(t) for t in np.linspace(0, 6, 25)])
        assert moving.any(axis=0).sum() >= 6, kind


@pytest.mark.parametrize("seed", [0, 1, 5, 7, 14])
def test_long_vehicles_and_people_on_a_roundabout_never_touch(seed: int) -> None:
    """A quarter buses, a quarter trucks and people: nobody whom the seed has drawn is the user's to change."""
    table = read_scene(ROOT / "scenes" / "tiny.toml")
    busy = replace(table, seed=seed, street=STREETS["roundabout"](), signal=None, vehicles=(), blocks=(),
                   flows=(Flow(per_hour=400, buses=0.25, trucks=0.25, turning=0.4),),
                   pedestrians=Pedestrians(crossing=10, strolling=10),
                   traffic=Traffic(step_s=0.1, warm_up_s=40.0))  # fmt: skip
    fleet = make_fleet(busy, 8.0)
    kinds = [instance.kind for instance in fleet.instances]
    assert kinds.count("bus") + kinds.count("truck") >= 8
    assert kinds.count("pedestrian") >= 18
    assert overlaps(fleet, 8.0) == []
    moving = np.array([fleet.moving(t) for t in np.linspace(0, 8, 17)])
    long = [kind in ("bus", "truck") for kind in kinds]
    assert moving.any(axis=0)[long].mean() >= 0.5  # they wait for the ring and for each other


def test_long_vehicles_that_wait_for_each_other_do_not_stand_for_ever() -> None:
    """Where both of two waited, the ring of this seed stood still after a minute."""
    network, traffic = STREETS["roundabout"]().network(False), Traffic(step_s=0.1, warm_up_s=40.0)
    flows = (Flow(per_hour=400, buses=0.25, trucks=0.25, turning=0.4),)
    population = populate(network, (), flows, traffic, Parking(), Pedestrians(crossing=10), 0, 90.0)
    count = len(population.cars)
    drives = simulate(network, population.cars, population.walkers, None, traffic, -40.0, 90.0)
    there = drives.here(89.0)[:count]
    assert drives.speeds(89.0)[:count][there].mean() > 1.5
    assert (drives.present[:, :count].any(axis=0) & ~there).sum() > 20


def test_who_crosses_beside_a_junction_gives_way_to_its_traffic() -> None:
    """People who would walk into the other street walk the other way, and the note says so."""
    table = read_scene(ROOT / "scenes" / "tiny.toml")
    busy = replace(table, street=Crossroads(), signal=None, vehicles=(), blocks=(), seed=3,
                   flows=(Flow(per_hour=400, buses=0.25, trucks=0.25),),
                   pedestrians=Pedestrians(crossing=10, strolling=10),
                   traffic=Traffic(step_s=0.1, warm_up_s=40.0))  # fmt: skip
    fleet = make_fleet(busy, 20.0)
    assert overlaps(fleet, 20.0) == []
    assert "on foot walk another way" in fleet.notes[0]
    assert [instance.kind for instance in fleet.instances].count("pedestrian") >= 18


def test_two_long_vehicles_share_no_bend_that_both_sweep() -> None:
    """Into and out of a roundabout by the same arm: the centre lines keep clear, the bodies do not."""
    network = STREETS["roundabout"]().network(False)
    for arm in ("east", "north", "west", "south"):
        assert [c.other for c in network.swept[f"{arm}-entry"]] == [f"{arm}-exit"]
        assert f"{arm}-exit" not in [c.other for c in network.conflicts[f"{arm}-entry"]]
    assert not any(STREETS["straight"]().network(False).swept.values())
    crossroads = STREET.network(False)
    assert "west-east/0" not in [c.other for c in crossroads.swept["east-west/0"]]  # straight past each other


def test_of_two_who_touch_one_that_was_drawn_gives_way() -> None:
    placed, track, car, late, walker, strolling, bay = (
        ("placed", 0), ("track", 0), ("car", 3), ("car", 9), ("walker", 2), ("walker", 7), ("parked", 4)
    )  # fmt: skip
    none = Amends()
    assert amend(none, [(placed, track), (placed, ("placed", 1))], 5) == none
    assert amend(none, [(placed, car), (car, late)], 5) == Amends(cars=frozenset({3}))
    assert amend(none, [(car, late), (bay, placed)], 5) == Amends(cars=frozenset({9}), parked=frozenset({4}))
    once = amend(none, [(car, walker), (walker, late), (strolling, late)], 5)
    assert once == Amends(turned=frozenset({2}), walkers=frozenset({7}))
    assert amend(once, [(walker, car)], 5) == Amends(turned=frozenset({2}), walkers=frozenset({2, 7}))
    assert once.left_out == 1


def test_vehicles_come_and_go(scene: Scene) -> None:
    short = replace(scene.street, arm_m=50.0)
    flowing = replace(scene, street=short, vehicles=(), flows=(Flow(per_hour=900),), traffic=Traffic(step_s=0.1))
    fleet = make_fleet(flowing, 10.0)
    present = np.array([fleet.present(t) for t in np.linspace(0, 10, 101)])
    assert (~present[0] & present[-1]).any()
    assert (present[0] & ~present[-1]).any()
    speeds = np.array([fleet.speed_mps(t) for t in np.linspace(0, 10, 101)])
    assert (speeds[~present] == 0).all()


def test_forty_thousand_instances_are_checked_and_keep_their_ids() -> None:
    side = 200
    parked = tuple(Parked("saloon", (6.0 * (k % side), 3.0 * (k // side)), 0.0) for k in range(side * side))
    standing = Standing(parked)
    instances = tuple(Instance(k + 1, f"p{k}", "saloon", (0.1, 0.1, 0.1)) for k in range(len(parked)))
    fleet = Fleet(instances, (standing,))
    assert overlapping(fleet, 0.0) == []
    assert fleet.object_to_world(0.0)[-1, :2, 3].tolist() == [6.0 * 199, 3.0 * 199]
    assert [np.float32(i.id) == i.id for i in instances].count(False) == 0  # what the id pass holds is exact
    planted = Fleet(instances, (Standing((*parked[:-1], Parked("saloon", (6.0, 1.0), 0.0))),))
    assert overlapping(planted, 0.0) == [(1, 39_999)]
