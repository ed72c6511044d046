"""Panels on real, small work: what their numbers come from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aa4d.capture.reader import read_capture, read_image
from aa4d.capture.truth import moving_mask
from aa4d.cost import PANELS, panel_of
from aa4d.cost.inputs import source_of
from aa4d.cost.panel import SIZES, Measurement, Point, Setup
from aa4d.cost.panels import (
    export_quantisation,
    playback,
    playback_looks,
    synthesis_effects,
    synthesis_traffic,
    training_iterations,
    training_scale,
    training_threads,
)
from aa4d.cost.rows import points_of
from aa4d.cost.run import choose, uses_capture
from aa4d.cost.scaled import write_scaled
from aa4d.errors import InputError
from aa4d.graph.engines import Means, engine_of
from aa4d.graph.scheduler import run_graph
from aa4d.graph.store import Store
from tests.toy_capture import write_toy_capture

BRIEF = replace(SIZES["quick"], schedule=(8, 12), repeats=1)


def measured(measurements: tuple[Measurement, ...], store: Path) -> list[Point]:
    tasks = [measurement.task for measurement in measurements]
    outcome = run_graph(tasks, Store(store), engine_of("inline", Means()), lambda _: None)
    assert not outcome.failures
    return points_of(measurements, {digest: kept.result for digest, kept in outcome.kept.items()})


@pytest.fixture(scope="module")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Setup:
    return Setup(BRIEF, write_toy_capture(tmp_path_factory.mktemp("toy") / "capture"))


def test_smaller_frames_are_means_and_keep_cameras_movers_and_splits(toy: Setup, tmp_path: Path) -> None:
    assert toy.capture is not None
    whole = read_capture(toy.capture)
    write_scaled(whole, 0.5, tmp_path / "half")
    half = read_capture(tmp_path / "half")
    assert [frame.split for frame in half.frames] == [frame.split for frame in whole.frames]
    assert np.allclose(half.camera.K[:2], whole.camera.K[:2] / 2)
    assert np.allclose(half.points, whole.points)
    large, small = read_image(whole, whole.frames[3]), read_image(half, half.frames[3])
    means = large.reshape(small.shape[0], 2, small.shape[1], 2, 3).mean(axis=(1, 3))
    assert np.abs(small - means).max() <= 0.51
    shares = [np.mean(moving_mask(capture, 3)) for capture in (whole, half)]
    assert shares[1] == pytest.approx(shares[0], rel=0.3)
    assert shares[0] > 0


def test_a_training_is_one_task_however_many_panels_ask_for_it(toy: Setup) -> None:
    scale = {m.task.needs[0].digest for m in training_scale.measurements(toy)}
    quantised = export_quantisation.measurements(toy)[0].task.needs[0].digest
    assert quantised in scale


def test_a_capture_that_no_chosen_panel_measures_on_is_refused(toy: Setup) -> None:
    with pytest.raises(InputError, match=r"--capture .*: has no effect on .*raster-precision; leave it out"):
        choose(toy, ("raster-precision", "synthesis-traffic"))
    assert "raster-precision" in choose(toy, ("raster-precision", "training-offsets")).panels
    using = {name for name in PANELS if uses_capture(toy, panel_of(name).measurements(toy))}
    made_up = ("synthesis-", "raster-", "network-", "training-threads")  # measured on scenes of their own
    assert using == {name for name in PANELS if not name.startswith(made_up)}


def test_image_scale_and_quantisation_are_measured_on_a_toy(toy: Setup, tmp_path: Path) -> None:
    found = measured((*training_scale.measurements(toy), *export_quantisation.measurements(toy)), tmp_path)
    scales, steps = found[:3], found[3:]
    assert [point.label for point in scales if point.is_default] == ["1 times"]
    assert all(point.processor_s > 0 and 5 < (point.quality or 0) < 60 for point in scales)
    decibels = [point.quality or 0 for point in steps]
    assert decibels == sorted(decibels, reverse=True)  # the coarser, the worse
    bytes_of_one = [point.more["bytes a Gaussian and key"] for point in steps]
    assert bytes_of_one == sorted(bytes_of_one, reverse=True)  # type: ignore[type-var]


def test_threads_are_as_before_after_each_number_of_them_was_timed(toy: Setup, tmp_path: Path) -> None:
    import torch

    before = torch.get_num_threads()
    found = measured(training_threads.measurements(toy), tmp_path)
    assert torch.get_num_threads() == before
    assert found[0].label == "1 thread"
    assert all(point.quality == pytest.approx(1e3 * point.wall_s) for point in found if point.wall_s)


def test_the_longest_quick_schedule_is_what_the_preset_has() -> None:
    labels = list(training_iterations.variants(Setup(SIZES["quick"])))
    assert labels[-1] == "800 + 3000"
    assert [m.is_default for label in labels for m in training_iterations_points(label)].count(True) == 1


def training_iterations_points(label: str) -> list[Point]:
    from aa4d.cost.training import points

    result = dict.fromkeys(("training_processor_seconds", "training_seconds", "psnr", "anchors", "total_mib", "fps"), 1)
    return points(label, label == "800 + 3000", result)


def test_a_rendered_capture_is_needed_where_none_is_given() -> None:
    (render,) = source_of(Setup(BRIEF)).needs
    assert render.kind == "render"
    assert render.settings.path.name == "quick.toml"


def test_tables_of_synthesis_become_points_without_what_was_refused() -> None:
    result = {
        "traffic": [
            {"step_s": 1.0, "refused": "two vehicles collide"},
            {"step_s": 0.02, "seconds": 0.2, "processor_s": 0.1, "worst_m": 0.01, "mean_m": 0.001},
        ],
        "effects": [
            {"effect": "none", "picture": 1, "truth": 2, "picture_processor_s": 3, "truth_processor_s": 4},
            {"effect": "haze", "refused": "it cannot"},
        ],
    }
    (step,) = synthesis_traffic.points(result)
    assert (step.label, step.processor_s, step.quality, step.is_default) == ("0.02 s", 0.1, 0.01, True)
    (none,) = synthesis_effects.points(result)
    assert (none.processor_s, none.wall_s, none.is_default) == (7, 3, True)


def test_playback_is_live_by_default_and_cheaper_while_it_plays() -> None:
    row = {
        "carrier": "anchors",
        "live_ms": 30.0,
        "live_processor_ms": 20.0,
        "exact_processor_ms": 15.0,
        "playing_processor_ms": 9.0,
        "baked_ms": 2.0,
        "baked_processor_ms": 1.0,
    }
    error = {"p99_mm": 10.0, "bake_s": 0.0, "keys": 9}
    accuracy = [
        {"what": "live, while the timeline plays", "mean_mm": 1.5, **error},
        {"what": "keys every frame", "mean_mm": 3.0, **error, "bake_s": 2.0},
    ]
    rest, playing, baked = playback.points({"rows": [row], "accuracy": accuracy})
    assert (rest.quality, rest.processor_s) == (0.0, 0.02)
    assert playing.is_default
    assert playing.processor_s == pytest.approx(0.014)
    assert (baked.processor_s, baked.quality, baked.more["bake, s"]) == (0.001, 3.0, 2.0)
    accuracy[0]["keys"] = 1  # a clip too short for knots is evaluated as at rest
    assert playback.points({"rows": [row], "accuracy": accuracy})[1].processor_s == rest.processor_s


def test_the_default_look_is_the_one_that_a_new_import_has() -> None:
    row = {"trained_picture": "no", "seen_from": "capture", "harmonics": 0, "processor_s": 1.0, "db": 20.0}
    looks = [
        row | {"look": look, "trained_picture": trained}
        for look in ("Gaussians", "Native Splats")
        for trained in ("no", "yes")
    ]
    frozen = row | {"look": "Native Splats", "trained_picture": "yes", "seen_from": "frozen"}
    found = playback_looks.points({"pictures": [*looks, frozen, frozen | {"harmonics": 1}]})
    assert [p.label for p in found] == [
        "Gaussians",
        "Gaussians, Trained Picture",
        "Native Splats",
        "Native Splats, Trained Picture",
        "Native Splats, Trained Picture, seen from one place",
        "Native Splats, Trained Picture, seen from one place, harmonics of degree 1",
    ]
    assert [p.label for p in found if p.is_default] == ["Native Splats"]
    assert [p.label for p in playback_looks.points({"pictures": looks[:2]}) if p.is_default] == ["Gaussians"]
