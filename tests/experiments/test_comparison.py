"""The comparison of methods: its entries, its tables, which frames and cuts it shows, and what nothing beats."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aa4d.capture.reader import read_capture
from aa4d.errors import InputError
from aa4d.experiments.comparison import TRACKED, base_settings, comparison_of, entries, title_of
from aa4d.experiments.comparison_tables import POOLED, Comparison, Failure, failed_lines, table_of, write_comparison
from aa4d.experiments.kinds.evaluate import Row
from aa4d.experiments.pareto import front, plot_pareto
from aa4d.experiments.side_by_side import ASPECT, Panel, compose, crops_of, frames_to_show
from aa4d.experiments.trials import Outcome, Trial
from aa4d.methods import METHODS
from aa4d.methods.adaanchor4d.settings import PRESETS
from aa4d.methods.fourdgs import settings as fourdgs
from tests.toy_capture import HEIGHT, WIDTH, write_toy_capture

CONDITIONS = {
    "command": "aa4d compare a b --out c",
    "preset": "quick",
    "coarse_iterations": 800,
    "fine_iterations": 1500,
    "seeds": [0, 1],
    "jobs": 1,
    "processors": 2,
    "threads": 2,
}
TITLES = {"fourdgs": "4D-GS", "adaanchor4d": "AdaAnchor4D"}


def row(capture: str, entry: str, seed: int, psnr: float, **more: float) -> Row:
    cost = {"minutes": 2.0, "processor_minutes": 2.0, "fps": 20.0, "total_mib": 9.0}
    return {"capture": capture, "variant": entry, "seed": seed, "psnr": psnr, **cost, **more}


ROWS = [
    row("a", "fourdgs", 0, 20.0, motion_epe_px=1.0),
    row("a", "fourdgs", 1, 22.0, motion_epe_px=2.0),
    row("b", "fourdgs", 0, 30.0),
    row("b", "fourdgs", 1, 32.0),
    row("a", "adaanchor4d", 0, 21.0, motion_epe_px=0.5),
    row("a", "adaanchor4d", 1, 25.0, motion_epe_px=0.5),
    row("b", "adaanchor4d", 0, 31.0),
    row("b", "adaanchor4d", 1, 29.0),
]


def test_every_method_is_an_entry_and_the_tracked_one_beside_the_papers() -> None:
    assert set(entries()) == {*METHODS, TRACKED}
    experiment = comparison_of(entries())
    settings = {v.label: v.settings(PRESETS["quick"]) for v in experiment.variants}
    assert settings["adaanchor4d"].motion is None
    assert settings[TRACKED].motion is not None
    assert settings[TRACKED].method == "adaanchor4d"
    assert all(settings[name].method == name for name in METHODS)
    assert title_of(TRACKED) == "AdaAnchor4D + tracks"
    assert len({title_of(entry) for entry in entries()}) == len(entries())


def test_all_run_over_as_many_iterations() -> None:
    base = base_settings(comparison_of(entries()), "quick", (80, 150))
    for variant in comparison_of(entries()).variants:
        settings = variant.settings(base)
        assert (settings.coarse_iterations, settings.fine_iterations) == (80, 150)


def test_a_preset_that_a_method_lacks_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    fewer = {name: preset for name, preset in fourdgs.PRESETS.items() if name != "standard"}
    monkeypatch.setattr(fourdgs, "PRESETS", fewer)
    with pytest.raises(
        InputError, match="--preset standard: fourdgs has none of that name; choose one of quick, paper"
    ):
        base_settings(comparison_of(("fourdgs", "adaanchor4d")), "standard", None)


def test_pooled_is_the_mean_over_captures_and_the_deviation_over_seeds() -> None:
    """4D-GS has 25 with the first seed over both captures and 27 with the second; AdaAnchor4D 26 and 27."""
    pooled = {mean.entry: mean for mean in Comparison(TITLES, CONDITIONS, ROWS).pooled()}
    psnr = pooled["fourdgs"].spreads["psnr"]
    assert (psnr.mean, psnr.deviation) == (26.0, pytest.approx(2**0.5))
    assert pooled["adaanchor4d"].spreads["psnr"].mean == 26.5
    assert pooled["fourdgs"].spreads["motion_epe_px"].mean == 1.5, "over the one capture with that truth"


def test_what_is_not_there_for_all_is_not_pooled() -> None:
    unfinished = Comparison(TITLES, CONDITIONS, ROWS[:-1])
    assert {mean.entry: mean.spreads["psnr"].mean for mean in unfinished.pooled()} == {
        "fourdgs": 21.0,
        "adaanchor4d": 23.0,
    }
    failed = Comparison(TITLES, CONDITIONS, ROWS[:-1], (Failure("b", "adaanchor4d", 1, "diverged"),))
    assert [mean.entry for mean in failed.pooled()] == ["fourdgs"]
    assert failed.pooled()[0].spreads["psnr"].mean == 26.0
    assert failed_lines(failed, "b", 3) == [["AdaAnchor4D: failed (seed 1)", "", ""]]
    assert failed_lines(failed, "a", 3) == []


def test_all_captures_are_named_only_where_the_mean_is_over_several(tmp_path: Path) -> None:
    complete, unfinished = (Comparison(TITLES, CONDITIONS, rows) for rows in (ROWS, ROWS[:-1]))
    assert (complete.pooled_over(), unfinished.pooled_over()) == (["a", "b"], ["a"])
    assert complete.pooled_over("motion_epe_px") == ["a"]
    for comparison, is_told in ((complete, True), (unfinished, False)):
        write_comparison(comparison, tmp_path, [])
        assert ("## All captures" in (tmp_path / "compare.md").read_text()) is is_told


def test_a_table_that_is_unfinished_names_the_runs_that_are_missing(tmp_path: Path) -> None:
    trials = [
        Trial(Path(c), e, s, PRESETS["quick"], PRESETS["quick"], Path()) for c in "ab" for e in TITLES for s in (0, 1)
    ]
    outcome = Outcome(ROWS[:-2], {"b, adaanchor4d, seed 0": "diverged"})
    comparison = Comparison.of(outcome, trials, TITLES, CONDITIONS)
    write_comparison(comparison, tmp_path, [])
    page = (tmp_path / "compare.md").read_text()
    assert "**Unfinished: 1 of 8 runs missing: b, adaanchor4d, seed 1.** The same command goes on." in page
    assert json.loads((tmp_path / "compare.json").read_text())["missing"] == ["b, adaanchor4d, seed 1"]
    write_comparison(Comparison.of(Outcome(ROWS), trials, TITLES, CONDITIONS), tmp_path, [])
    page = (tmp_path / "compare.md").read_text()
    assert "Unfinished" not in page
    assert "2 threads, one run after" in page
    assert "1 job at a time on 2 processors, with" in page


def test_the_best_is_marked_by_what_is_good_and_truth_that_is_not_there_is_blank(tmp_path: Path) -> None:
    comparison = Comparison(TITLES, CONDITIONS, [*ROWS, row("b", "adaanchor4d", 2, 40.0, minutes=1.0)])
    here = [mean for mean in comparison.means() if mean.capture == "b"]
    headings, theirs, ours = table_of(comparison, here, lambda text, place: f"{text} [{place}]")
    assert headings == ["method", "PSNR ↑", "FPS ↑", "minutes ↓", "processor minutes ↓", "MiB ↓"]
    assert theirs[1].endswith("[1]")
    assert ours[1] == "33.33 ±5.86 [0]"
    assert ours[2] == "20.0 ±0.0", "what all have alike is nobody's"
    assert ours[3].endswith("[0]")
    write_comparison(Comparison(TITLES, CONDITIONS, ROWS), tmp_path, ["pareto.png"])
    page = (tmp_path / "compare.md").read_text()
    assert "| AdaAnchor4D | **30.00 ±1.41** |" not in page
    assert "| 4D-GS | **31.00 ±1.41** |" in page
    assert "![pareto](pareto.png)" in page
    assert "NaN" not in page
    with (tmp_path / "table.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert [(line["capture"], line["method"]) for line in lines[-2:]] == [(POOLED, "fourdgs"), (POOLED, "adaanchor4d")]
    assert lines[2]["motion_epe_px"] == ""
    assert float(lines[0]["psnr_deviation"]) == pytest.approx(2**0.5)
    document = json.loads((tmp_path / "compare.json").read_text())
    assert document["rows"] == ROWS
    assert document["pooled"][0]["spreads"]["psnr"]["mean"] == 26.0


def test_nothing_beats_what_is_on_the_front() -> None:
    points = [(1.0, 20.0), (2.0, 25.0), (3.0, 24.0), (4.0, 26.0), (1.0, 19.0)]
    assert front(points, -1) == [0, 1, 3], "less cost is better"
    assert front(points, 1) == [3], "more speed is better"
    assert front([(1.0, 30.0), (2.0, 20.0)], 1) == [1, 0]


def test_the_plot_is_drawn_for_one_capture_and_for_several(tmp_path: Path) -> None:
    untimed = [{key: value for key, value in row.items() if key != "fps"} for row in ROWS]
    for name, rows in (("one", ROWS[:2]), ("two", ROWS), ("untimed", untimed)):
        plot_pareto(Comparison(TITLES, CONDITIONS, rows), tmp_path / f"{name}.png")
        with Image.open(tmp_path / f"{name}.png") as plot:
            assert plot.width > 600
    plot_pareto(Comparison(TITLES, CONDITIONS, []), tmp_path / "none.png")
    assert not (tmp_path / "none.png").exists()


def test_the_frames_with_most_that_moves_are_shown_and_cut_around_it(tmp_path: Path) -> None:
    capture = read_capture(write_toy_capture(tmp_path / "capture"))
    assert frames_to_show(capture, 5) == capture.of_split("test")
    (window,) = crops_of(capture, 8)
    mask = np.load(tmp_path / "capture/truth/000008.npz")["instance_id"] == 1
    rows, columns = mask.nonzero()
    assert window[0] <= columns.min()
    assert columns.max() < window[2] <= WIDTH
    assert 0 <= window[1] <= rows.min()
    assert rows.max() < window[3] <= HEIGHT
    assert abs((window[2] - window[0]) / (window[3] - window[1]) - 2 * ASPECT) < 0.4, "a single one is wide"


def test_a_frame_without_truth_is_shown_whole(tmp_path: Path) -> None:
    folder = write_toy_capture(tmp_path / "capture")
    document = json.loads((folder / "capture.json").read_text())
    del document["tracks"]
    (folder / "capture.json").write_text(json.dumps(document))
    capture = read_capture(folder)
    assert crops_of(capture, 8) == []
    assert len(frames_to_show(capture, 1)) == 1


def test_a_picture_has_a_panel_for_each_method_and_one_that_failed() -> None:
    picture = np.full((32, 48, 3), 200, np.uint8)
    panels = [Panel("Truth", picture), Panel("A", picture, "20 dB"), Panel("B", None), Panel("C", picture)]
    sizes = {n: compose([*panels, *panels][:n], [(4, 4, 12, 10)], "caption").size for n in (2, 3, 4, 6, 8)}
    assert sizes[4][0] == sizes[2][0] < sizes[3][0] == sizes[6][0] < sizes[8][0]
    assert sizes[4][1] == sizes[6][1] == sizes[8][1] > 1.8 * sizes[3][1]
