"""Experiments that turn one knob: derived scenes, thinned captures, scores against the knob."""

import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aa4d.capture.reader import read_capture, read_image
from aa4d.capture.truth import moving_mask
from aa4d.errors import InputError
from aa4d.evaluation.second_drone import second_capture
from aa4d.experiments.against import curve, plot_against
from aa4d.experiments.axis import Knob
from aa4d.experiments.derived_scene import derived
from aa4d.experiments.experiment_file import read_experiment
from aa4d.experiments.graphs import experiment_graph
from aa4d.experiments.kinds.render import Rendering
from aa4d.experiments.kinds.render import run as render
from aa4d.experiments.kinds.thin import Thinning, kept_frames, run
from aa4d.graph.call import Call
from aa4d.graph.task import Task, in_order

HEAD = 'title = "A"\nscenes = ["s.toml"]\n[variants.paper]\n'
AXIS = """
[scene.camera]
width_px = 160
[axis]
label = "frames per second"
values = [12, 24]
[axis.scene.time]
fps = [12, 24]
frames = [48, 96]
"""
SCENE = (
    'name = "s"\n[time]\nfps = 6\nframes = 9\n[tracks]\nfile = "t.csv"\nbridge_s = 0.5\n[[blocks]]\nfloors = [2, 3]\n'
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "s.toml").write_text(SCENE)
    (tmp_path / "t.csv").write_text("a row")
    return tmp_path


def write(folder: Path, text: str) -> Path:
    path = folder / "e.toml"
    path.write_text(text)
    return path


def test_a_derived_scene_has_the_changes_and_all_else_of_the_scene(folder: Path) -> None:
    text = derived(folder / "s.toml", "s-24", {"time": {"fps": 24.0}, "effects": {"motion_blur": {"exposure_s": 0.01}}})
    assert tomllib.loads(text) == {
        "name": "s-24",
        "time": {"fps": 24.0, "frames": 9},
        "tracks": {"file": "t.csv", "bridge_s": 0.5},
        "blocks": [{"floors": [2, 3]}],
        "effects": {"motion_blur": {"exposure_s": 0.01}},
    }


def test_every_value_of_the_knob_is_a_scene_of_its_own(folder: Path) -> None:
    tables = experiment_graph(read_experiment(write(folder, HEAD + AXIS)))
    renders = [task for task in in_order([tables]) if task.kind == "render"]
    assert [(task.name, task.settings.changes) for task in renders] == [
        ("s-12", {"camera": {"width_px": 160}, "time": {"fps": 12, "frames": 48}}),
        ("s-24", {"camera": {"width_px": 160}, "time": {"fps": 24, "frames": 96}}),
    ]
    with renders[1].settings.file() as scene:
        table = tomllib.loads(scene.read_text())
        assert (scene.parent / "t.csv").read_text() == "a row"  # synth takes only what lies beside a scene
    assert (scene.name, table["name"], table["time"]) == ("s-24.toml", "s-24", {"fps": 24, "frames": 96})
    assert not scene.exists()
    assert [entry.named for entry in tables.settings.entries] == [
        {"capture": f"s {at}", "variant": "paper", "seed": 0, "at": float(at)} for at in (12, 24)
    ]
    assert tables.settings.knob == Knob("frames per second")


def test_what_the_renderer_refuses_names_the_scene_and_its_place_on_the_axis(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_program: str, scene: str, *_: str, hear: Callable[[str], None]) -> int:
        hear(f"{scene}: time.fpss: unknown key; did you mean 'fps'?")
        return 2

    monkeypatch.setattr("aa4d.experiments.kinds.render.run_in_blender", refuse)
    task = Task("render", "s-24", Rendering.of(folder / "s.toml", {"time": {"fpss": 24}}, "s-24"))
    with pytest.raises(InputError) as refused:
        render(Call(task, folder / "out", (), {}, lambda _: None))
    assert str(refused.value) == f"{folder / 's.toml'}, as s-24: time.fpss: unknown key; did you mean 'fps'?"


def test_a_scene_without_changes_is_the_scene_that_it_was(folder: Path) -> None:
    plain = experiment_graph(read_experiment(write(folder, HEAD)))
    thinned = experiment_graph(
        read_experiment(write(folder, HEAD + '[axis]\nlabel = "n"\nvalues = [1, 4]\nkeep_every = [1, 4]'))
    )
    assert thinned.needs[0].digest == plain.needs[0].digest
    tasks = in_order([thinned])
    assert [task.name for task in tasks if task.kind == "render"] == ["s"], "rendered once"
    assert [task.settings.keep_every for task in tasks if task.kind == "thin"] == [4]


def test_every_nth_training_frame_is_left_and_every_held_out_one(toy_capture: Path, tmp_path: Path) -> None:
    splits = ["test", *("train",) * 5, "test", "train"]
    assert kept_frames(splits, 1) == list(range(8))
    assert kept_frames(splits, 2) == [0, 1, 3, 5, 6]
    assert kept_frames(splits, 4) == [0, 1, 5, 6]
    whole = read_capture(toy_capture)
    (folder := tmp_path / "thin").mkdir()
    task = Task("thin", "toy", Thinning(2, whole.identity.digest(), toy_capture))
    result = run(Call(task, folder, (), {}, lambda _: None))
    thin = read_capture(folder)
    assert [f.name for f in thin.frames] == [
        whole.frames[i].name for i in kept_frames([f.split for f in whole.frames], 2)
    ]
    assert result["training_frames"] == len(thin.of_split("train")) == -(-len(whole.of_split("train")) // 2)
    assert thin.identity != whole.identity
    for index, frame in enumerate(thin.frames):
        before = [f.name for f in whole.frames].index(frame.name)
        assert (frame.t, frame.time_s) == (whole.frames[before].t, whole.frames[before].time_s)
        assert np.array_equal(read_image(thin, frame), read_image(whole, whole.frames[before]))
        ours, theirs = moving_mask(thin, index), moving_mask(whole, before)
        assert (ours is None) == (theirs is None)
        assert ours is None or theirs is None or np.array_equal(ours, theirs)


def test_a_second_drone_and_masks_are_left_at_the_same_instants(toy_capture: Path, tmp_path: Path) -> None:
    source = tmp_path / "whole"
    shutil.copytree(toy_capture, source)
    shutil.copytree(toy_capture, source / "second")
    for name in ("000001", "000002", "all"):
        path = source / "left_out" / f"{name}.png"
        path.parent.mkdir(exist_ok=True)
        Image.new("L", (read_capture(source).camera.width, read_capture(source).camera.height), 255).save(path)
    (folder := tmp_path / "thin").mkdir()
    task = Task("thin", "toy", Thinning(4, read_capture(source).identity.digest(), source))
    run(Call(task, folder, (), {}, lambda _: None))
    thin = read_capture(folder)
    second = second_capture(thin)
    assert second is not None
    assert len(second.frames) == len(thin.frames) < len(read_capture(source).frames)
    names = {frame.name for frame in thin.frames}
    assert {path.stem for path in (folder / "left_out").iterdir()} == {"all", *(names & {"000001", "000002"})}


def test_scores_are_drawn_in_the_order_of_the_knob(tmp_path: Path) -> None:
    rows = [
        {"capture": f"s {at:g}", "variant": variant, "seed": seed, "at": at, "psnr": 20 + at + seed}
        for at in (4.0, 1.0)
        for variant in ("a", "b")
        for seed in (0, 2)
    ]
    assert curve([row for row in rows if row["variant"] == "a"], "psnr") == ([1.0, 4.0], [22.0, 25.0], [2**0.5] * 2)
    plot_against(Knob("n", log=True), "title", rows, tmp_path / "plot.png")
    with Image.open(tmp_path / "plot.png") as picture:
        assert np.asarray(picture.convert("L")).std() > 5


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("label", "lable"), "axis.lable: unknown key; did you mean label?"),
        (('label = "frames per second"\n', ""), "axis.label: missing; say what is varied, and its values"),
        (("values = [12, 24]\n", ""), "axis.values: missing; say what is varied, and its values"),
        (("[12, 24]\n[axis", "[12, 12]\n[axis"), "axis.values: the number 12.0 stands there twice; name each once"),
        (("[12, 24]\n[axis", "[12, 12.0000001]\n[axis"), "axis.values: two of them are alike to six digits"),
        (("[12, 24]\n[axis", "[0, 24]\nlog = true\n[axis"), "axis.log: 0 has no logarithm"),
        (
            ("fps = [12, 24]", "fps = [12]"),
            "axis.scene.time.fps: must be a list with an entry for each of the 2 values",
        ),
        (("[axis.scene.time]\nfps", "keep_every = [2]\n[axis.scene.time]\nfps"), "axis.keep_every: needs a number for"),
        (("[axis.scene.time]\nfps = [12, 24]\nframes = [48, 96]\n", ""), "axis.scene: missing; say which keys of the"),
        (('"s.toml"', '"capture"'), "scenes: {folder}/capture: is a capture, in which no key of a scene can change"),
        (("[scene.camera]\nwidth_px = 160", "scene = 3"), "scene: is a section; it cannot be the number 3"),
    ],
)
def test_an_axis_that_makes_no_sense_is_refused(folder: Path, change: tuple[str, str], says: str) -> None:
    (folder / "capture").mkdir()
    (folder / "capture/capture.json").touch()
    text = HEAD.replace("[variants.paper]\n", "") + AXIS + "[variants.paper]\n"
    assert change[0] in text
    path = write(folder, text.replace(*change))
    with pytest.raises(InputError) as refused:
        read_experiment(path)
    assert says.format(folder=folder) in str(refused.value)
