"""Experiments on the toy capture: real processes, stopped, killed and continued."""

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.experiments.kinds.evaluate import Row
from aa4d.experiments.tables import write_tables
from aa4d.experiments.trials import Outcome, Trial, run_experiment, task_of, trials_of
from aa4d.experiments.variants import ABLATIONS, SWEEPS, Experiment, Variant
from aa4d.files import write_json
from aa4d.graph.engines import Means, engine_of
from aa4d.graph.events import Event, Failed, Finished, Said
from aa4d.graph.store import Store
from aa4d.graph.work import Job, perform
from aa4d.methods.adaanchor4d.aggregations import AGGREGATIONS
from aa4d.methods.adaanchor4d.settings import PRESETS, AdaAnchor4DSettings
from aa4d.methods.settings import with_iterations
from tests.capture.test_content import change_frame
from tests.training.short_run import SHORT

TINY = replace(SHORT, coarse_iterations=4, fine_iterations=4)
TWO = Experiment(
    "two", "Two", (Variant("product", {"aggregation": "product"}), Variant("gamma 2", warp={"gamma": 2.0}))
)


class Quiet:
    """Remembers what it was told."""

    def __init__(self) -> None:
        self.finished = 0
        self.ended: list[str] = []

    def __call__(self, event: Event) -> None:
        if isinstance(event, Finished) and event.before:
            self.finished += 1
        elif isinstance(event, Finished | Failed):
            self.ended.append(event.task.name)


def run_all(experiment: Experiment, trials: list[Trial], out: Path, jobs: int, watcher: Quiet) -> list[Row]:
    def write(outcome: Outcome) -> None:
        if outcome.rows:
            write_tables(experiment, outcome.rows, out)

    engine = engine_of("processes", Means(jobs))
    return run_experiment(experiment, trials, out, engine, lambda _: watcher, write).checked()


def test_trials_run_once_side_by_side_and_their_rows_stay(toy_capture: Path, tmp_path: Path) -> None:
    out = tmp_path / "two"
    trials = trials_of(TWO, [toy_capture], out, TINY, 1)
    first, again = Quiet(), Quiet()
    rows = run_all(TWO, trials, out, 2, first)
    assert [row["variant"] for row in rows] == ["product", "gamma 2"]
    assert len(first.ended) == 2
    written = (out / "rows.csv").read_bytes()
    assert run_all(TWO, trials, out, 2, again) == rows
    assert (again.finished, again.ended) == (2, [])
    assert (out / "rows.csv").read_bytes() == written
    assert (out / "capture/product/seed0/model.safetensors").exists()
    with pytest.raises(InputError, match="another training"):
        run_all(TWO, trials_of(TWO, [toy_capture], out, replace(TINY, voxel_px=9.0), 1), out, 1, Quiet())


def test_a_capture_of_that_name_that_is_another_is_refused_and_more_seeds_are_added(
    toy_capture: Path, tmp_path: Path
) -> None:
    out, one = tmp_path / "one", Experiment("one", "One", (Variant("good"),))
    run_all(one, trials_of(one, [toy_capture], out, TINY, 1), out, 1, Quiet())
    rows = run_all(one, trials_of(one, [toy_capture], out, TINY, 2), out, 1, Quiet())
    assert [row["seed"] for row in rows] == [0, 1]
    index = json.loads((out / "experiment.json").read_text())
    assert index["training"].pop("exposure") is False, "as a version wrote it that knew no such setting"
    assert index["training"]["rates"].pop("exposures")
    (out / "experiment.json").write_text(json.dumps(index))
    run_all(one, trials_of(one, [toy_capture], out, TINY, 1), out, 1, Quiet())
    index = json.loads((out / "experiment.json").read_text())
    assert (index["seeds"], index["training"]["fine_iterations"], list(index["captures"])) == ([0, 1], 4, ["capture"])
    with pytest.raises(InputError, match=r"holds runs with another training\.fine_iterations: 4 there, 5 asked for"):
        run_all(one, trials_of(one, [toy_capture], out, replace(TINY, fine_iterations=5), 1), out, 1, Quiet())
    change_frame(toy_capture)
    with pytest.raises(InputError, match="its runs of capture were made from another capture than"):
        run_all(one, trials_of(one, [toy_capture], out, TINY, 1), out, 1, Quiet())
    assert json.loads((out / "experiment.json").read_text()) == index


def test_a_row_of_another_version_is_measured_again(toy_capture: Path, tmp_path: Path) -> None:
    out, one = tmp_path / "one", Experiment("one", "One", (Variant("good"),))
    trial = trials_of(one, [toy_capture], out, TINY, 1)[0]
    store, task = Store(out), task_of(trial, read_capture(toy_capture), out)
    assert store.kept(task, {}) is None
    done = perform(Job(out, task, {}, {}), lambda _: None)
    assert store.kept(task, {}) == done
    row = done.result
    of_old = {key: value for key, value in row.items() if key not in ("run", "version")}
    for kept, is_known in ((row | {"version": "0.0.1"}, False), (row | {"run": "0"}, False), (of_old, True)):
        write_json(trial.out / "trial.json", kept)
        assert (store.kept(task, {}) is not None) == is_known


def test_a_result_that_was_edited_by_hand_is_made_again_and_named(toy_capture: Path, tmp_path: Path) -> None:
    one = Experiment("one", "One", (Variant("good"),))
    trial = trials_of(one, [toy_capture], tmp_path, TINY, 1)[0]
    store, task = Store(tmp_path), task_of(trial, read_capture(toy_capture), tmp_path)
    row = perform(Job(tmp_path, task, {}, {}), lambda _: None).result
    model, result = trial.out / "model.safetensors", trial.out / "trial.json"
    right = model.read_bytes()
    marked = json.loads(result.read_text())
    for path, edited in (
        (model, right[:-1] + bytes([right[-1] ^ 1])),
        (result, json.dumps(marked | {"psnr": 99.0}).encode()),
        (result, json.dumps(marked | {"seed": 0.0}).encode()),
    ):
        path.write_bytes(edited)
        assert store.kept(task, {}) is None
        events: list[Event] = []
        again = perform(Job(tmp_path, task, {}, {}), events.append).result
        said = [event.text for event in events if isinstance(event, Said)]
        assert said[0] == f"{path} is not as it was made; {task.title} is made again"
        assert {k: v for k, v in again.items() if k in ("psnr", "ssim")} == {k: row[k] for k in ("psnr", "ssim")}
        assert model.read_bytes() == right
        assert store.kept(task, {}) is not None


def test_what_a_trial_leaves_is_an_ordinary_run_and_its_row(toy_capture: Path, tmp_path: Path) -> None:
    one = Experiment("one", "One", (Variant("good"),))
    run_all(one, trials_of(one, [toy_capture], tmp_path / "x", TINY, 1), tmp_path / "x", 1, Quiet())
    left = {path.name for path in (tmp_path / "x/capture/good/seed0").iterdir()} - {".lock"}
    assert left == {
        *("checkpoint.safetensors", "coarse.safetensors", "config.json", "eval", "history.csv", "metrics.json"),
        *("model.safetensors", "settings.toml", "trial.json"),
    }


def test_a_trial_that_fails_does_not_stop_the_others(toy_capture: Path, tmp_path: Path) -> None:
    broken = Experiment("one", "One", (Variant("bad", {"aggregation": "vote"}), Variant("good")))
    watcher = Quiet()
    with pytest.raises(InputError, match=r"1 of 2 runs failed; first error: aggregation 'vote' is unknown"):
        run_all(broken, trials_of(broken, [toy_capture], tmp_path / "x", TINY, 1), tmp_path / "x", 1, watcher)
    with (tmp_path / "x/rows.csv").open() as file:
        assert [row["variant"] for row in csv.DictReader(file)] == ["good"]


def test_captures_of_one_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="two captures are called 'c'"):
        trials_of(TWO, [tmp_path / "a/c", tmp_path / "b/c"], tmp_path, TINY, 1)


def test_a_folder_of_something_else_is_left_alone(toy_capture: Path, tmp_path: Path) -> None:
    desk = tmp_path / "desk"
    desk.mkdir()
    (desk / "letter.txt").touch()
    with pytest.raises(InputError, match="not empty and not the runs of an experiment"):
        run_all(TWO, trials_of(TWO, [toy_capture], desk, TINY, 1), desk, 1, Quiet())
    assert [path.name for path in desk.iterdir()] == ["letter.txt"]
    out = tmp_path / "sweep"
    out.mkdir()
    (out / "experiment.json").write_text('{"experiment": "another"}')
    with pytest.raises(InputError, match="holds the runs of an experiment with other settings"):
        run_all(TWO, trials_of(TWO, [toy_capture], out, TINY, 1), out, 1, Quiet())


def test_every_variant_is_one_that_training_knows() -> None:
    for experiment in (*ABLATIONS.values(), *SWEEPS.values()):
        labels = [variant.label for variant in experiment.variants]
        assert len({label.replace(" ", "-") for label in labels}) == len(labels)
        for variant in experiment.variants:
            variant.settings(PRESETS["quick"])
    assert {v.model["aggregation"] for v in ABLATIONS["aggregation"].variants} == set(AGGREGATIONS)
    paper = PRESETS["paper"]
    first = [e.variants[0].settings(paper) for e in SWEEPS.values()]
    assert all(isinstance(s, AdaAnchor4DSettings) and replace(s, model=paper.model) == paper for s in first)


def test_a_shorter_schedule_keeps_its_proportions() -> None:
    config = with_iterations(PRESETS["quick"], 80, 300)
    assert (config.coarse_iterations, config.fine_iterations) == (80, 300)
    window = config.densification
    assert (window.statistics_from, window.start, window.until) == (10, 30, 180)


def command(capture: Path, out: Path, fine: int) -> list[str]:
    options = ["--out", str(out), "--seeds", "1", "--jobs", "2", "--iterations", "10", str(fine)]
    return [sys.executable, "-m", "aa4d.cli", "sweep", "smoothing", str(capture), *options]


def wait_for(condition: Path) -> None:
    deadline = time.monotonic() + 60
    while not condition.exists():
        assert time.monotonic() < deadline, f"{condition} never came"
        time.sleep(0.05)


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_a_stopped_or_killed_sweep_leaves_no_process_and_continues(
    toy_capture: Path, tmp_path: Path, how: signal.Signals
) -> None:
    out = tmp_path / "sweep"
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(
        command(toy_capture, out, 200), env=environment, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    wait_for(out / "capture/1.5-bins/seed0/coarse.safetensors")
    process.send_signal(how)
    _, said = process.communicate(timeout=60)
    if how == signal.SIGINT:
        assert process.returncode == 130
        assert re.search(r"0 of 3 tasks done, and the same command continues", said)
        assert (out / "capture/1.5-bins/seed0/model.safetensors").exists()
    # The lock of a run is free once its process is gone; else the same command would be refused.
    result = subprocess.run(
        command(toy_capture, out, 200), env=environment, capture_output=True, text=True, timeout=180
    )
    if how == signal.SIGKILL and "another process is training there" in result.stderr:
        time.sleep(2)
        result = subprocess.run(
            command(toy_capture, out, 200), env=environment, capture_output=True, text=True, timeout=180
        )
    assert result.returncode == 0, result.stderr
    assert (out / "table.md").read_text().count("±") == 0
    assert len((out / "table.md").read_text().splitlines()) == 7


def test_a_process_whose_starter_was_killed_before_it_began_ends(tmp_path: Path) -> None:
    program = """
import multiprocessing, time, types
from aa4d.graph.engines import processes
multiprocessing.parent_process = lambda: types.SimpleNamespace(pid=1)  # not the parent any more
processes.attempt = lambda *_: time.sleep(300)
processes._work(None, types.SimpleNamespace(send=print))
"""
    ended = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, timeout=120, check=False)
    assert ended.returncode == 1
