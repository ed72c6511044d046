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
from synth.traffic.actors import Car
from synth.traffic.fleet import BODIES
from synth.traffic.following import ballistic, idm_acceleration, within_gap
from synth.traffic.instances import Fleet, Instance, Standing, overlapping
from synth.traffic.network import Network, joints
from synth.traffic.population import Parked, populate
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


def test_idm_survives_zero_gap_and_high_closing_speed() -> None:
    speed, gap = np.array([0.0, 10.0, 40.0]), np.array([0.0, 0.0, 5.0])
    acceleration = idm_acceleration(speed, np.full(3, 15.0), gap, speed, Traffic())
    assert np.isfinite(acceleration).all()
    position, after = ballistic(np.zeros(3), speed, acceleration, 1.0)
    assert (after >= 0).all()
    assert (position >= 0).all()


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
