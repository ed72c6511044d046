"""Tables of tracks: SUMO's floating car data and measured ones."""

import importlib.util
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from synth.errors import InputError
from synth.plan import make_fleet, make_plan
from synth.spec import Scene, Traffic, read_scene
from synth.traffic.fleet import BODIES
from synth.traffic.sumo import kind_of_type
from synth.traffic.tracks import Tracks, TrackTable, read_tracks

CSV_HEAD = (
    "timestep_time;vehicle_angle;vehicle_id;vehicle_lane;vehicle_pos;vehicle_speed;vehicle_type;vehicle_x;vehicle_y"
)


def sumo_csv(path: Path, rows: list[tuple[float, str, float, float, float]]) -> Path:
    """Rows of time, id, x, y, angle."""
    lines = [f"{t};{angle};{name};l;0;0;DEFAULT_VEHTYPE;{x};{y}" for t, name, x, y, angle in rows]
    path.write_text("\n".join([CSV_HEAD, *lines]) + "\n")
    return path


def read(path: Path, form: str = "sumo", **keys: object) -> Tracks:
    return read_tracks(TrackTable(file=path.name, format=form, **keys), path.parent, 10.0)  # type: ignore[arg-type]


def test_front_bumper_and_clockwise_angle_are_converted(tmp_path: Path) -> None:
    """Driving east at 10 m/s: SUMO's angle is 90 degrees, its position the front bumper."""
    path = sumo_csv(tmp_path / "f.csv", [(0.1 * k, "a", 1.0 * k, 5.0, 90.0) for k in range(31)])
    tracks = read(path)
    centres, headings = tracks.poses(1.5)
    assert centres[0] == pytest.approx([15.0 - BODIES["saloon"].length_m / 2, 5.0])
    assert headings[0] == pytest.approx(0.0, abs=1e-12)
    assert tracks.speeds(1.5)[0] == pytest.approx(10.0)
    north = read(sumo_csv(tmp_path / "n.csv", [(0.1 * k, "a", 5.0, 1.0 * k, 0.0) for k in range(31)]))
    assert north.poses(1.0)[1][0] == pytest.approx(math.pi / 2)
    assert north.poses(1.0)[0][0] == pytest.approx([5.0, 10.0 - BODIES["saloon"].length_m / 2])


def test_xml_and_csv_are_the_same(tmp_path: Path) -> None:
    rows = [(0.5 * k, "a", 3.0 * k, 0.1 * k * k, 90.0 - 2.0 * k) for k in range(20)]
    table = read(sumo_csv(tmp_path / "f.csv", rows))
    steps = "".join(
        f'<timestep time="{t}"><vehicle id="{n}" x="{x}" y="{y}" angle="{a}" type="car" speed="0"/></timestep>'
        for t, n, x, y, a in rows
    )
    (tmp_path / "f.xml").write_text(f"<fcd-export>{steps}</fcd-export>")
    other = read(tmp_path / "f.xml")
    for time_s in np.linspace(0, 9.5, 50):
        np.testing.assert_array_equal(table.poses(float(time_s))[0], other.poses(float(time_s))[0])


def test_sideways_jump_at_a_lane_change_does_not_turn_the_vehicle_on_the_spot(tmp_path: Path) -> None:
    rows = [(0.04 * k, "a", 0.4 * k, 0.0 if k < 100 else 3.2, 90.0) for k in range(200)]
    tracks = read(sumo_csv(tmp_path / "f.csv", rows))
    headings = np.array([tracks.poses(float(t))[1][0] for t in np.arange(0, 7.9, 0.01)])
    assert np.abs(np.diff(headings)).max() < math.radians(4)  # SUMO's own direction of motion jumps by 83 degrees
    assert headings[0] == pytest.approx(0.0, abs=1e-9)
    assert headings[-1] == pytest.approx(0.0, abs=1e-9)


def test_who_stands_keeps_its_heading(tmp_path: Path) -> None:
    """Stops after a bend, with noise of a centimetre, and goes on."""
    angle = np.concatenate([np.linspace(0, math.pi / 2, 40), np.full(60, math.pi / 2), np.full(40, math.pi / 2)])
    step = np.concatenate([np.full(40, 0.5), np.zeros(60), np.full(40, 0.5)])
    x, y = np.cumsum(step * np.cos(angle)), np.cumsum(step * np.sin(angle))
    rows = [(0.1 * k, "a", x[k], y[k], 90.0 - math.degrees(angle[k])) for k in range(140)]
    tracks = read(sumo_csv(tmp_path / "f.csv", rows))
    standing = np.array([tracks.poses(float(t))[1][0] for t in np.linspace(4.5, 9.5, 101)])
    assert np.ptp(standing) < 1e-9
    assert standing[0] == pytest.approx(math.pi / 2, abs=0.25)
    assert tracks.speeds(7.0)[0] == 0.0


def test_positions_between_samples_are_continuous_whatever_the_frame_rate(tmp_path: Path) -> None:
    """30 frames a second against samples of 40 ms: neither divides the other, nor a whole millisecond."""
    rows = [(0.04 * k, "a", 0.02 * (0.04 * k) ** 2 * 100, 0.0, 90.0) for k in range(200)]
    tracks = read(sumo_csv(tmp_path / "f.csv", rows))
    for fps in (30.0, 29.97, 7.3):
        x = np.array([tracks.poses(k / fps)[0][0, 0] for k in range(int(7.9 * fps))])
        exact = 2.0 * (np.arange(len(x)) / fps) ** 2 - BODIES["saloon"].length_m / 2
        assert np.abs(x - exact)[2:].max() < 2e-3


def test_sideways_jump_at_a_lane_change_takes_seconds(tmp_path: Path) -> None:
    """3.2 m within 40 ms are 80 m/s: the change is spread, at the speed that the vehicle has."""
    rows = [(0.04 * k, "a", 0.4 * k, 0.0 if k < 100 else 3.2, 90.0) for k in range(200)]
    tracks = read(sumo_csv(tmp_path / "f.csv", rows))
    speeds = np.array([tracks.speeds(float(t))[0] for t in np.arange(0, 7.9, 0.01)])
    assert 9.9 < speeds.min() <= speeds.max() < 10.6  # hypot(10, 3.2 * 1.875 / 2)
    for time_s, y in ((2.9, 0.0), (3.98, 1.6), (5.1, 3.2)):
        assert tracks.poses(time_s)[0][0, 1] == pytest.approx(y, abs=1e-6)


@pytest.mark.parametrize("step_s", [0.04, 0.1, 0.5, 1.0])
def test_who_is_missing_in_the_table_is_absent(tmp_path: Path, step_s: float) -> None:
    """Rows are missing for 1.5 s or more: no position is invented, and the note says so."""
    times = [step_s * k for k in range(int(10 / step_s) + 1) if not 4.0 < step_s * k < 5.9]
    tracks = read(sumo_csv(tmp_path / "f.csv", [(t, "a", 10.0 * t, 5.0, 90.0) for t in times]))
    before, after = max(t for t in times if t <= 4.0), min(t for t in times if t >= 5.9)
    for time_s in (0.0, 3.2, before, after, 9.0):
        assert tracks.here(time_s).tolist() == [True], time_s
        assert tracks.speeds(time_s)[0] == pytest.approx(10.0)
        assert tracks.poses(time_s)[0][0, 0] == pytest.approx(10 * time_s - BODIES["saloon"].length_m / 2)
    for time_s in np.linspace(before + 1e-6, after - 1e-6, 9):
        assert tracks.here(float(time_s)).tolist() == [False]
        assert tracks.speeds(float(time_s)).tolist() == [0.0]
        assert np.isfinite(tracks.poses(float(time_s))[0]).all()
    assert f"gaps in tracks: 1, of up to {after - before:.3g} s" in tracks.notes[0]
    bridged = read(tmp_path / "f.csv", bridge_s=2.5)
    assert bridged.here(5.0).tolist() == [True]
    assert bridged.notes == ()


def test_a_table_of_coarse_steps_has_no_gaps(tmp_path: Path) -> None:
    tracks = read(sumo_csv(tmp_path / "f.csv", [(2.0 * k, "a", 20.0 * k, 5.0, 90.0) for k in range(6)]))
    assert all(tracks.here(t).all() for t in (0.0, 1.0, 5.5, 10.0))
    assert tracks.notes == ()


@pytest.mark.parametrize("step_s", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("jump_m", [30.0, 75.0, -40.0])
def test_steps_that_nobody_could_drive_are_refused_or_split(tmp_path: Path, step_s: float, jump_m: float) -> None:
    last = round(5.0 / step_s)
    rows = [(step_s * k, "a", 10.0 * step_s * k + (jump_m if k > last else 0.0), 0.0, 90.0) for k in range(2 * last)]
    path = sumo_csv(tmp_path / "f.csv", rows)
    with pytest.raises(InputError, match=r"'a' would have to move at .* m/s from 5 s to .*tracks\.jumps") as caught:
        read(path)
    assert f" {abs(10 * step_s + jump_m) / step_s:.0f} m/s" in str(caught.value)
    split = read(path, jumps="split")
    assert split.here(5.0).tolist() == split.here(5.0 + step_s).tolist() == [True]
    assert split.here(5.0 + 0.5 * step_s).tolist() == [False]
    speeds = [split.speeds(float(t))[0] for t in np.linspace(0, (2 * last - 1) * step_s, 401)]
    assert max(speeds) == pytest.approx(10.0)


def test_hard_braking_noise_and_a_fast_start_are_no_jumps(tmp_path: Path) -> None:
    """9 m/s² to a stand, centimetres of noise at 25 Hz, and 5 m/s² from a stand at 1 Hz."""
    t = np.arange(0, 8, 0.04)
    braking = np.where(t < 4, 25 * t, 100 + 25 * np.minimum(t - 4, 25 / 9) - 4.5 * np.minimum(t - 4, 25 / 9) ** 2)
    noisy = braking + np.random.default_rng(0).normal(0, 0.2, len(t))
    assert read(sumo_csv(tmp_path / "f.csv", [(a, "a", x, 0.0, 90.0) for a, x in zip(t, noisy, strict=True)]))
    slow = [(float(k), "a", 2.5 * max(0, k - 4) ** 2, 0.0, 90.0) for k in range(9)]
    assert read(sumo_csv(tmp_path / "s.csv", slow)).speeds(7.5)[0] > 10


def test_a_row_that_stands_alone_is_left_out(tmp_path: Path) -> None:
    """One row far off, at any step: both steps are jumps, and the row between them is no stretch."""
    for step_s in (0.1, 1.0):
        rows = [(step_s * k, "a", 10.0 * step_s * k, 60.0 if k == 5 else 0.0, 90.0) for k in range(11)]
        split = read(sumo_csv(tmp_path / "f.csv", rows), jumps="split")
        assert split.here(5 * step_s).tolist() == [False]
        assert [len(stretch.times_s) for stretch in split.tracks[0].stretches] == [5, 5]
        assert "left out: 1." in split.notes[-1]


def test_vehicles_are_present_while_the_table_has_them(tmp_path: Path) -> None:
    rows = [(0.5 * k, "a", 5.0 * k, 0.0, 90.0) for k in range(5)] + [
        (4 + 0.5 * k, "b", 5.0 * k, 9.0, 90.0) for k in range(5)
    ]
    tracks = read(sumo_csv(tmp_path / "f.csv", rows), start_s=1.0)
    assert tracks.here(0.0).tolist() == [True, False]
    assert tracks.here(2.0).tolist() == [False, False]
    assert tracks.here(3.5).tolist() == [False, True]
    assert tracks.speeds(2.0).tolist() == [0.0, 0.0]


def test_who_is_not_there_during_the_clip_is_left_out(tmp_path: Path) -> None:
    """SUMO's time may start anywhere: a clip without anybody is refused with the times that there are."""
    rows = [(120 + k, "a", 5.0 * k, 0.0, 90.0) for k in range(3)] + [
        (140 + k, "b", 5.0 * k, 9.0, 90.0) for k in range(3)
    ]
    path = sumo_csv(tmp_path / "f.csv", rows)
    assert [track.name for track in read(path, start_s=121.0).tracks] == ["a"]
    with pytest.raises(InputError, match=r"from 120 s to 142 s, the clip from 0 s to 10 s; set tracks\.start_s"):
        read(path)


def test_overlapping_tracks_are_refused_by_their_ids(quiet_scene: Scene, tmp_path: Path) -> None:
    rows = [(0.5 * k, name, 2.0 * k + x, 0.0, 90.0) for name, x in (("no 7", 0.0), ("8", 3.0)) for k in range(9)]
    sumo_csv(tmp_path / "f.csv", rows)
    with pytest.raises(
        InputError, match=r"track-no_7-saloon-001 and track-8-saloon-002 overlap .* in the table of tracks"
    ):
        make_plan(replace(quiet_scene, tracks=TrackTable(file="f.csv", format="sumo")), tmp_path)
    table = TrackTable(file="f.csv", format="sumo", overlaps="allow")
    assert len(make_plan(replace(quiet_scene, tracks=table), tmp_path).fleet.instances) == 2


def test_far_origin_is_refused_and_recentred_on_request(tmp_path: Path) -> None:
    rows = [(0.1 * k, "a", 500_000.0 + k, 5_000_000.0, 90.0) for k in range(21)]
    path = sumo_csv(tmp_path / "f.csv", rows)
    with pytest.raises(InputError, match="recentre = true"):
        read(path)
    tracks = read(path, recentre=True)
    assert np.abs(tracks.poses(1.0)[0]).max() < 15
    assert tracks.origin_m[1] == 5_000_000.0


def test_measured_tracks(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    lines = [f"a,{0.2 * k},{2.0 * k},1.0,bus" for k in range(20)] + [
        f"p,{0.2 * k},0.0,{7 + 0.25 * k},pedestrian" for k in range(20)
    ]
    path.write_text("id,time_s,x_m,y_m,kind\n" + "\n".join(lines) + "\n")
    tracks = read(path, "metres")
    assert tracks.kinds == ("bus", "pedestrian")
    assert tracks.poses(1.0)[0][0] == pytest.approx([10.0, 1.0])
    assert tracks.poses(1.0)[1][1] == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(
    ("name", "kind", "doubt"),
    [
        ("moped", "cyclist", "stands in"),  # not a pedestrian, though "ped" is a part of it
        ("motorcycle", "cyclist", "stands in"),
        ("tram", "bus", "stands in"),
        ("rail_urban", "bus", "stands in"),
        ("bus_1", "bus", ""),
        ("cityBus2", "bus", ""),
        ("buses", "saloon", "unknown"),
        ("rebus", "saloon", "unknown"),
        ("Vanessa", "saloon", "unknown"),
        ("caravan", "saloon", "unknown"),
        ("ped_pedestrian", "pedestrian", ""),
        ("veh_passenger", "saloon", ""),
        ("DEFAULT_VEHTYPE", "saloon", ""),
        ("DEFAULT_PEDTYPE", "pedestrian", ""),
        ("DEFAULT_BIKETYPE", "cyclist", ""),
        ("delivery", "van", ""),
        ("truck-trailer", "truck", ""),
        ("cars", "saloon", ""),
        ("type7", "saloon", "unknown"),
        ("", "saloon", "unknown"),
    ],
)
def test_types_are_matched_by_whole_words(name: str, kind: str, doubt: str) -> None:
    assert kind_of_type(name) == (kind, doubt)


def test_vehicle_classes_decide_and_what_is_unknown_is_said_once(tmp_path: Path) -> None:
    steps = "".join(
        f'<timestep time="{t}">'
        + "".join(f'<vehicle id="{n}" x="{9 * t}" y="{9 * k}" angle="90" type="{n}"/>' for k, n in enumerate("abc"))
        + f'<person id="p" x="0" y="{t}" angle="0" type="bus"/></timestep>'
        for t in range(5)
    )
    (tmp_path / "f.xml").write_text(f"<fcd-export>{steps}</fcd-export>")
    tracks = read(tmp_path / "f.xml")
    assert tracks.kinds == ("saloon", "saloon", "saloon", "pedestrian")
    assert len(tracks.notes) == 1
    assert "unknown class, shown as a saloon: 'a', 'b', 'c'; set tracks.types" in tracks.notes[0]
    types = '<vType id="a" vClass="bus"/><vType id="b" vClass="moped"/><vType id="c"/>'
    (tmp_path / "types.xml").write_text(f"<additional>{types}</additional>")
    told = read(tmp_path / "f.xml", types="types.xml")
    assert told.kinds == ("bus", "cyclist", "saloon", "pedestrian")
    assert [note.split(": ", 1)[1] for note in told.notes] == [
        "types without a body of their own, for which another stands in: a cyclist for 'b'."
    ]
    (tmp_path / "types.xml").write_text("<additional/>")
    with pytest.raises(InputError, match="holds no <vType>"):
        read(tmp_path / "f.xml", types="types.xml")
    with pytest.raises(InputError, match=r"tracks\.types: '\.\./t\.xml' must lie in"):
        read(tmp_path / "f.xml", types="../t.xml")
    with pytest.raises(InputError, match=r"absent\.xml: cannot read"):
        read(tmp_path / "f.xml", types="absent.xml")


def test_types_are_refused_for_measured_tracks(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("id,time_s,x_m,y_m\na,0,0,0\na,1,9,0\n")
    with pytest.raises(InputError, match=r"tracks\.types: .* column kind"):
        read(tmp_path / "m.csv", "metres", types="types.xml")


def test_people_of_a_csv_table_are_read(tmp_path: Path) -> None:
    head = "timestep_time;person_angle;person_id;person_x;person_y;vehicle_angle;vehicle_id;vehicle_type;vehicle_x;"
    lines = [f"{t};0;p;0;{t};;;;;\n{t};;;;;90;v;bus;{9 * t};9" for t in range(5)]
    (tmp_path / "f.csv").write_text(head + "vehicle_y\n" + "\n".join(lines) + "\n")
    tracks = read(tmp_path / "f.csv")
    assert dict(zip((t.name for t in tracks.tracks), tracks.kinds, strict=True)) == {"p": "pedestrian", "v": "bus"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a;b\n1;2\n", "columns"),
        (CSV_HEAD + "\n", "holds no tracks"),
        (CSV_HEAD + "\n0;90;a;l;0;0;t;nan;0\n1;90;a;l;0;0;t;1;0\n", "line 2: x: 'nan' must be a finite number"),
        (CSV_HEAD + "\n0;90;a;l;0;0;t;0;0\n", "one sample only"),
        (CSV_HEAD + "\n1;90;a;l;0;0;t;0;0\n1;90;a;l;0;0;t;2;0\n", "two places at 1 s"),
    ],
)
def test_bad_tables_are_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "f.csv").write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        read(tmp_path / "f.csv")
    assert "\n" not in str(caught.value)


def test_files_outside_the_scenes_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="folder"):
        read_tracks(TrackTable(file="../secret.csv", format="sumo"), tmp_path, 1.0)
    with pytest.raises(InputError, match="cannot read"):
        read(tmp_path / "absent.csv")


@pytest.fixture(scope="module")
def quiet_scene() -> Scene:
    scene = read_scene(Path(__file__).resolve().parents[2] / "scenes" / "tiny.toml")
    return replace(scene, vehicles=(), signal=None, traffic=Traffic(parked_share=0.0))


def test_a_table_is_scaled_turned_and_shifted_in_this_order(tmp_path: Path) -> None:
    """Front bumpers in feet, driving east along y = 100 ft; to drive north along x = -7 m."""
    rows = [(0.1 * k, "a", 3.0 * k, 100.0, 90.0) for k in range(31)]
    path = sumo_csv(tmp_path / "f.csv", rows)
    placed = read(path, scale=0.3048, turn_deg=90.0, shift_m=(100 * 0.3048 - 7.0, 50.0))
    (centre,), (heading,) = placed.poses(1.5)
    behind = BODIES["saloon"].length_m / 2  # metres, whatever the table's unit
    assert centre == pytest.approx([-7.0, 50.0 + 45 * 0.3048 - behind])
    assert heading == pytest.approx(math.pi / 2)
    assert placed.speeds(1.5)[0] == pytest.approx(30 * 0.3048)
    plain, same = read(path), read(path, scale=1.0, turn_deg=0.0, shift_m=(0.0, 0.0))
    for time_s in np.linspace(0, 3, 31):
        np.testing.assert_array_equal(plain.poses(float(time_s))[0], same.poses(float(time_s))[0])
    utm = sumo_csv(tmp_path / "u.csv", [(t, n, x + 5e5, y + 5e6, a) for t, n, x, y, a in rows])
    assert np.abs(read(utm, shift_m=(-5e5, -5e6)).poses(1.0)[0] - plain.poses(1.0)[0]).max() < 1e-6


def test_the_way_off_the_road_is_told(quiet_scene: Scene, tmp_path: Path) -> None:
    """Along the road, over the lawn, and half of each; people on the pavement do not count."""

    def note(y: float, **keys: object) -> str:
        lines = [f"a,{t},{9 * t - 25},{y},suv\np,{t},{9 + t},9,pedestrian" for t in range(6)]
        (tmp_path / "m.csv").write_text("id,time_s,x_m,y_m,kind\n" + "\n".join(lines) + "\n")
        table = TrackTable(file="m.csv", format="metres", **keys)  # type: ignore[arg-type]
        return make_fleet(replace(quiet_scene, tracks=table), 5.0, tmp_path).notes[-1]

    assert note(-1.6) == "tracks: 0.0% of the vehicles' way lies off the road."
    share = float(note(-20.0).split("tracks: ")[1].split("%")[0])
    assert 60 < share < 85  # it crosses the other street
    assert "turn_deg and shift_m place the table" in note(-20.0)
    assert note(-20.0, shift_m=(0.0, 18.4)) == note(-1.6)
    assert note(900.0).startswith("tracks: 100.0%")


def test_a_table_drives_a_scene(quiet_scene: Scene, tmp_path: Path) -> None:
    sumo_csv(tmp_path / "f.csv", [(0.1 * k, "a", 0.8 * k - 20, -1.6, 90.0) for k in range(60)])
    plan = make_plan(replace(quiet_scene, tracks=TrackTable(file="f.csv", format="sumo")), tmp_path)
    assert [i.name for i in plan.fleet.instances] == ["track-a-saloon-001"]
    assert plan.fleet.moving(1.0).tolist() == [True]


@pytest.mark.skipif(importlib.util.find_spec("sumo") is None, reason="needs eclipse-sumo (pip install eclipse-sumo)")
def test_sumo_itself(quiet_scene: Scene, tmp_path: Path) -> None:
    """A grid of two-lane streets simulated by SUMO: smooth headings, no overlaps, bodies behind their bumpers."""
    import sumo

    def run(tool: str, *arguments: object) -> None:
        command = [str(Path(sumo.SUMO_HOME) / "bin" / tool), *map(str, arguments)]
        subprocess.run(command, check=True, cwd=tmp_path, capture_output=True, timeout=120)

    run("netgenerate", "--grid", "--grid.number", 3, "--grid.length", 120, "-L", 2, "-o", "net.xml")
    flows = [("A1B1", "B1C1"), ("C1B1", "B1A1"), ("B0B1", "B1B2"), ("A1B1", "B1B2"), ("B2B1", "B1C1")]
    text = "".join(
        f'<flow id="f{k}" from="{a}" to="{b}" begin="0" end="40" period="4"/>' for k, (a, b) in enumerate(flows)
    )
    (tmp_path / "flows.xml").write_text(f"<routes>{text}</routes>")
    run("sumo", "-n", "net.xml", "-r", "flows.xml", "--step-length", 0.04, "--end", 40, "--fcd-output", "out.csv",
        "--lanechange.duration", 2.5, "--time-to-teleport", -1, "--collision.action", "warn")  # fmt: skip
    table = TrackTable(file="out.csv", format="sumo", start_s=25.0, recentre=True)
    scene = replace(quiet_scene, tracks=table)
    tracks = read_tracks(table, tmp_path, 8.0)
    assert len(tracks.tracks) > 20
    for stretch in (stretch for track in tracks.tracks for stretch in track.stretches):
        turn = np.abs(np.diff(stretch.headings))
        assert turn.max() < math.radians(6), "a heading jumps within 40 ms"
        standing = np.hypot(*np.diff(stretch.centres, axis=0).T) < 1e-9
        assert (turn[standing] < 1e-9).all()
    fleet = make_fleet(scene, 8.0, tmp_path)  # refuses overlaps
    assert fleet.moving(4.0).sum() > 5
    assert sys.modules.get("libsumo") is None  # a table, not a binding
