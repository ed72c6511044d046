"""Means, spreads and differences of an experiment's rows."""

import csv
import statistics
from pathlib import Path

import pytest
from PIL import Image

from aa4d.experiments.axis import Knob
from aa4d.experiments.kinds.evaluate import Row, numbers
from aa4d.experiments.tables import Spread, columns_of, differences_of, lines_of, write_tables
from aa4d.experiments.variants import Experiment, Variant

TWO = Experiment("two", "Two of them", (Variant("plain"), Variant("fancy")))


def row(capture: str, variant: str, seed: int, psnr: float, **more: float) -> Row:
    return {"capture": capture, "variant": variant, "seed": seed, "psnr": psnr, "ssim": 0.9, **more}


ROWS = [
    row("a", "plain", 0, 20.0),
    row("a", "plain", 1, 30.0),
    row("a", "fancy", 0, 21.0, psnr_dynamic=15.0),
    row("a", "fancy", 1, 31.5, psnr_dynamic=17.0),
    row("b", "fancy", 0, 25.0),
]


def test_gains_compare_seed_with_seed() -> None:
    """The seeds differ by 10 dB; the variants, on one seed, by 1 and 1.5."""
    plain, fancy, alone = lines_of(TWO, ROWS)
    assert plain.gain_db == Spread(0.0, 0.0, 2)
    assert fancy.gain_db == Spread(1.25, pytest.approx(statistics.stdev([1.0, 1.5])), 2)
    assert fancy.spreads["psnr"].mean == 26.25
    assert (alone.capture, alone.seeds, alone.gain_db) == ("b", 1, None)


def test_a_metric_that_some_lack_is_averaged_over_those_that_have_it() -> None:
    assert [column.key for column in columns_of(ROWS)] == ["psnr", "psnr_dynamic", "ssim"]
    plain, fancy, _ = lines_of(TWO, ROWS)
    assert "psnr_dynamic" not in plain.spreads
    assert fancy.spreads["psnr_dynamic"].text(1) == "16.0 ±1.4"


def test_a_single_seed_has_no_spread() -> None:
    assert Spread.of([3.0]).text(2) == "3.00"
    assert Spread.of([0.25]).text(2, signed=True) == "+0.25"


def test_numbers_keeps_what_a_table_can_hold() -> None:
    metrics = {"psnr": 20.5, "lpips": {"alex": 0.1}, "frames": [{"psnr": 1}], "psnr_dynamic": None, "why": "text"}
    assert numbers(metrics) == {"psnr": 20.5, "lpips.alex": 0.1}


def test_tables_hold_every_run_and_every_mean(tmp_path: Path) -> None:
    write_tables(TWO, ROWS, tmp_path)
    with (tmp_path / "rows.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(r["psnr"]) for r in rows] == [20, 30, 21, 31.5, 25]
    with (tmp_path / "table.csv").open() as file:
        table = list(csv.reader(file))
    assert table[2][:4] == ["a", "fancy", "2", "26.25 ±7.42"]
    assert table[2][-1] == "+1.25 ±0.35"
    assert "| a | fancy | 2 | 26.25 ±7.42 |" in (tmp_path / "table.md").read_text()
    with Image.open(tmp_path / "plot.png") as plot:
        assert plot.width > 300


def test_pooled_differences_pair_capture_and_seed() -> None:
    """Over three pairs of capture and seed +1, +1.5 and -1: mean 0.5, standard error of it stdev / sqrt(3)."""
    rows = [*ROWS, row("b", "plain", 0, 26.0)]
    (difference,) = differences_of(TWO, rows)
    assert (difference.variant, difference.over, difference.pairs) == ("fancy", "plain", 3)
    spread = difference.spreads["psnr"]
    assert spread.mean == pytest.approx(0.5)
    assert spread.standard_error == pytest.approx(statistics.stdev([1.0, 1.5, -1.0]) / 3**0.5)
    assert spread.mean_text(2) == "+0.50 ±0.76"
    assert "psnr_dynamic" not in difference.spreads, "no pair has both"


def test_every_variant_is_compared_with_every_earlier_one() -> None:
    three = Experiment("three", "Three", (Variant("a"), Variant("b"), Variant("c")))
    rows = [row("x", variant, 0, psnr) for variant, psnr in (("a", 1.0), ("b", 2.0), ("c", 4.0))]
    found = [(d.variant, d.over, d.spreads["psnr"].mean) for d in differences_of(three, rows)]
    assert found == [("b", "a", 1.0), ("c", "a", 3.0), ("c", "b", 2.0)]


def test_the_pooled_table_tells_of_motion_and_activity_and_of_pairs_that_lack_them(tmp_path: Path) -> None:
    more = {"travel_ratio": 0.5, "psnr_activity.static": 30.0, "psnr_training": 33.0}
    rows = [
        row("a", "plain", 0, 20.0, **more),
        row("a", "fancy", 0, 21.0, **{**more, "travel_ratio": 0.75, "psnr_activity.static": 32.0}),
        row("b", "plain", 0, 20.0),
        row("b", "fancy", 0, 23.0),
    ]
    write_tables(TWO, rows, tmp_path)
    with (tmp_path / "pooled.csv").open() as file:
        (line,) = csv.DictReader(file)
    assert line["PSNR"] == "+2.00 ±1.00"
    assert line["travel"] == "+0.25 (1 of 2)"
    assert line["PSNR static"] == "+2.00 (1 of 2)"
    assert line["training PSNR"] == "+0.00 (1 of 2)"
    assert "| fancy | plain | 2 | +2.00 ±1.00 |" in (tmp_path / "pooled.md").read_text()


def test_what_is_rounded_to_zero_has_no_sign_of_its_own() -> None:
    assert Spread(-0.004, 0.002, 2).text(2) == "0.00 ±0.00"
    assert Spread(-0.004, None, 1).text(2, signed=True) == "+0.00"
    assert Spread(-0.006, None, 1).text(2, signed=True) == "-0.01"


def test_names_may_hold_what_means_something_to_markdown_and_to_figures(tmp_path: Path) -> None:
    names = ("a|b", r"$\frac$")  # mathematics that cannot be read
    rows = [row("on $5_and_$", name, 0, 20.0) | {"at": 1.0} for name in names]
    experiment = Experiment("e", "what $x^^y$ costs", tuple(map(Variant, names)))
    for knob in (None, Knob("in $_$")):
        write_tables(experiment, rows, tmp_path, knob)
        assert (tmp_path / "plot.png").exists()
        (tmp_path / "plot.png").unlink()
    assert r"| on $5_and_$ | a\|b | 1 |" in (tmp_path / "table.md").read_text()
