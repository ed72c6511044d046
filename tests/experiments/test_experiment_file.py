"""Experiment files: what they say of every run, and what is refused."""

import subprocess
import sys
from pathlib import Path

import pytest

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.experiments.experiment_file import read_experiment
from aa4d.experiments.graphs import experiment_graph, part_of
from aa4d.graph.task import in_order
from aa4d.methods.adaanchor4d.settings import AdaAnchor4DSettings
from aa4d.methods.settings import AnchorSettings

SCENES = Path(__file__).resolve().parents[2] / "scenes"
GOOD = """
title = "Two of them"
scenes = ["capture"]
seeds = [0, 4]
iterations = [20, 60]
[settings]
checkpoint_every = 7
[variants.product]
aggregation = "product"
modules = ["dacw"]
[variants."4D-GS"]
method = "fourdgs"
[variants.tracked]
motion = "tracks"
settings.loss.dssim = 0.5
settings.checkpoint_every = 9
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "e.toml"
    path.write_text(text)
    return path


def test_a_variant_is_the_preset_with_what_the_file_and_it_say(toy_capture: Path) -> None:
    file = read_experiment(write(toy_capture.parent, GOOD))
    product, other, tracked = file.variants.values()
    assert list(file.variants) == ["product", "4D-GS", "tracked"]
    assert isinstance(product, AdaAnchor4DSettings)
    assert isinstance(tracked, AdaAnchor4DSettings)
    assert (product.model.aggregation, product.model.dlgd, product.model.dacw) == ("product", False, True)
    assert (tracked.model.aggregation, tracked.model.dlgd, tracked.loss.dssim) == ("acfa", True, 0.5)
    assert [v.checkpoint_every for v in (product, other, tracked)] == [7, 7, 9]
    assert other.method == "fourdgs"
    assert not isinstance(other, AnchorSettings)
    assert {(v.coarse_iterations, v.fine_iterations) for v in file.variants.values()} == {(20, 60)}
    assert [v.motion is None for v in file.variants.values()] == [True, True, False]


def test_every_scene_variant_and_seed_is_trained_and_scored_for_one_table(toy_capture: Path) -> None:
    tables = experiment_graph(read_experiment(write(toy_capture.parent, GOOD)))
    kinds = [task.kind for task in in_order([tables])]
    assert {kind: kinds.count(kind) for kind in set(kinds)} == {"train": 6, "evaluate": 6, "tabulate": 1}
    entries = tables.settings.entries
    assert [(e.capture, e.variant, e.seed) for e in entries[:4]] == [
        ("capture", "product", 0),
        ("capture", "4D-GS", 0),
        ("capture", "tracked", 0),
        ("capture", "product", 4),
    ]
    training = tables.needs[3].needs[0].settings
    assert (training.settings.seed, training.capture) == (4, read_capture(toy_capture).identity.digest())
    parts = [part_of(tables, number, 4) for number in (1, 2, 3, 4)]
    assert sorted(task.name for part in parts for task in part) == sorted(task.name for task in tables.needs)


def test_the_name_of_a_variant_and_its_place_are_no_part_of_what_it_is(toy_capture: Path, tmp_path: Path) -> None:
    first = experiment_graph(read_experiment(write(toy_capture.parent, GOOD)))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    toy_capture.rename(elsewhere / "capture")
    renamed = GOOD.replace("[variants.product]", '[variants."the product"]')
    second = experiment_graph(read_experiment(write(elsewhere, renamed)))
    assert [task.digest for task in first.needs] == [task.digest for task in second.needs]
    assert first.digest != second.digest, "the table has its name"


def test_a_scene_is_rendered_once_for_all_and_again_when_what_it_names_changes(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text('[tracks]\nfile = "t.csv"\n')
    (tmp_path / "t.csv").write_text("1")
    text = 'title = "A"\nscenes = ["s.toml"]\nseeds = [0, 1]\n[variants.paper]\n[variants.half]\nmodules = ["dlgd"]\n'
    path = write(tmp_path, text)
    before = experiment_graph(read_experiment(path))
    renders = [task for task in in_order([before]) if task.kind == "render"]
    assert [task.name for task in renders] == ["s"]
    (tmp_path / "t.csv").write_text("2")
    assert experiment_graph(read_experiment(path)).needs[0].digest != before.needs[0].digest


def test_the_examples_that_are_shipped_can_be_read() -> None:
    files = sorted((SCENES / "experiments").glob("*.toml"))
    assert files
    for path in files:
        assert in_order([experiment_graph(read_experiment(path))])[-1].kind == "tabulate"


def test_a_graph_is_planned_without_torch() -> None:
    """What is done is then seen to be done at once."""
    code = (
        "import sys; from pathlib import Path; from aa4d.experiments.run_file import show_plan\n"
        "show_plan(Path(sys.argv[1]), Path(sys.argv[2]), 1, None, ())\n"
        "assert 'torch' not in sys.modules"
    )
    file = SCENES / "experiments/aggregation.toml"
    subprocess.run([sys.executable, "-c", code, str(file), "no such folder"], check=True, timeout=120)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("title =", "titel ="), "titel: unknown key; did you mean title?"),
        (('title = "Two of them"', ""), "title: missing; say what is compared"),
        (('scenes = ["capture"]', ""), "scenes: missing; name scene files, which are rendered, or capture folders"),
        (
            ('["capture"]', '["captur"]'),
            "scenes[0]: {folder}/captur: neither a scene file (*.toml) nor a capture folder",
        ),
        (('["capture"]', '["tinny.toml"]'), "{folder}/tinny.toml: no such scene file; did you mean tiny.toml?"),
        (('["capture"]', '["capture", "capture"]'), "scenes[1]: two scenes are called 'capture'; rename a file or"),
        (("[0, 4]", "[0, 0]"), "seeds: the number 0 stands there twice; name each once"),
        (('["dacw"]', '["dlgd", "dlgd"]'), 'product.modules: the text "dlgd" stands there twice; name each once'),
        (("[0, 4]", "[-1]"), "seeds[0]: -1 is out of range"),
        (("[0, 4]", "[]"), "seeds: is empty; name at least one"),
        (("[20, 60]", "[20]"), "iterations: a list of 1 must be a list of 2"),
        (('"product"\nmod', '"produkt"\nmod'), 'aggregation: the text "produkt" must be one of'),
        (('["dacw"]', '["dakw"]'), 'variants.product.modules: the text "dakw" must be one of dlgd, dacw; did you mean'),
        (("aggregation =", "agregation ="), "variants.product.agregation: unknown key; did you mean aggregation?"),
        (("modules =", "modulse ="), "aggregation, modules, settings"),
        (
            ("modules =", "modulse ="),
            "variants.product.modulse: unknown key; did you mean modules? Allowed here: method",
        ),
        (("[settings]", "[setings]"), "setings: unknown key; did you mean settings? Allowed here: title, scenes"),
        (('"fourdgs"', '"fourdg"'), 'variants.4D-GS.method: the text "fourdg" must be one of'),
        (
            ('"fourdgs"', '"fourdgs"\nmotion = "tracks"'),
            "variants.4D-GS.motion: motion must be none, for",
        ),
        (
            ('"fourdgs"', '"fourdgs"\naggregation = "mean"'),
            "variants.4D-GS.aggregation: fourdgs has none; leave it out",
        ),
        (("loss.dssim", "loss.dsim"), "variants.tracked.settings.loss.dsim: unknown key; did you mean loss.dssim?"),
        (
            ("checkpoint_every = 7", 'preset = "paper"'),
            "settings.preset: `preset`, at the top of the file, is that of all",
        ),
        (("checkpoint_every = 7", "seed = 7"), "settings.seed: every run has one of `seeds`, at the top of the file"),
        (("[settings]\ncheckpoint_every = 7", "settings = 3"), "settings: is a section; it cannot be the number 3"),
        (("title", "preset = 'main'\ntitle"), "variants.product.method: adaanchor4d has no preset main; it has quick"),
        (("title", "resources.cores = 0\ntitle"), "resources.cores: 0 is out of range"),
    ],
)
def test_what_is_refused(toy_capture: Path, change: tuple[str, str], says: str) -> None:
    (toy_capture.parent / "tiny.toml").touch()
    assert change[0] in GOOD
    path = write(toy_capture.parent, GOOD.replace(*change))
    with pytest.raises(InputError) as refused:
        experiment_graph(read_experiment(path))
    assert says.format(folder=toy_capture.parent) in str(refused.value)
    assert str(refused.value).startswith(f"{path}: ")


@pytest.mark.parametrize("name", ["", " ", r"a\nb", r"a\u0007"])
def test_a_variant_has_a_name_that_can_be_read(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="is no name for tables and figures; write words on one line"):
        read_experiment(write(tmp_path, f'title = "A"\nscenes = ["s.toml"]\n[variants."{name}"]\n'))


def test_a_file_without_variants_or_that_is_no_table_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no variant; add a section"):
        read_experiment(write(tmp_path, 'title = "A"\nscenes = ["s.toml"]\n'))
    with pytest.raises(InputError, match=r"absent\.toml: no such experiment file"):
        read_experiment(tmp_path / "absent.toml")
    with pytest.raises(InputError, match="is not TOML"):
        read_experiment(write(tmp_path, "title ="))


def test_a_scene_file_is_told_from_an_experiment() -> None:
    scenes = [path for path in SCENES.rglob("*.toml") if path.parent != SCENES / "experiments"]
    assert scenes
    for path in scenes:
        with pytest.raises(InputError, match=r"looks like a scene file .*; name an experiment file"):
            read_experiment(path)


def test_keys_that_the_top_of_the_file_has_are_not_offered_among_settings(toy_capture: Path) -> None:
    with pytest.raises(InputError) as refused:
        read_experiment(write(toy_capture.parent, GOOD.replace("checkpoint_every = 7", "checkpoint_evry = 7")))
    said, allowed = str(refused.value).split("Allowed here: ")
    assert said.endswith("settings.checkpoint_evry: unknown key; did you mean checkpoint_every? ")
    assert "coarse_iterations" in allowed.split(", ")
    assert not {"seed", "preset"} & set(allowed.split(", "))
