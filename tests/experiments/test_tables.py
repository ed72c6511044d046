"""Means, spreads and differences of an experiment's rows."""

import csv
import statistics
from pathlib import Path

import pytest
from PIL import Image

from aa4d.experiments.tables import Spread, columns_of, lines_of, write_tables
from aa4d.experiments.trial import Row, numbers
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
    assert fancy.gain_db == Spread(1.25, pytest.approx(statistics.stdev([1.0, 1.5])), 2)  # type: ignore[arg-type]
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
