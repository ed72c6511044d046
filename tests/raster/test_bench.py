"""The benchmark's rows and tables, on scenes so small that their times mean nothing."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
import torch
from raster_scenes import camera, random_gaussians
from rich.console import Console

from aa4d.raster import Gaussians, Options, bench
from aa4d.raster.cutoffs import CUTOFFS
from aa4d.raster.native import draw
from aa4d.raster.reference import blend, project

TINY = bench.Scene(200, 64, 40, with_reference=True)


def quiet_console() -> Console:
    return Console(file=io.StringIO(), width=160)


def test_rows_have_what_the_issue_asks_for(tmp_path: Path) -> None:
    console, path = quiet_console(), tmp_path / "rows.json"
    rows = bench.bench((TINY,), repeats=2, json_path=path, console=console)
    assert json.loads(path.read_text()) == rows
    expected = {"gaussians", "width", "height", "forward_ms", "backward_ms", "pairs", "bound_fraction_forward"}
    expected |= {"bound_fraction_backward", "thread_speedup", "peak_mib"}
    assert expected <= rows[0].keys()
    assert rows[0]["gaussians"] == 200
    assert "200" in console.file.getvalue()  # type: ignore[attr-defined]


def test_table_fits_80_columns() -> None:
    console = Console(file=io.StringIO(), width=80)
    bench.bench((TINY,), repeats=1, console=console)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "backward" in text
    assert "Gaussians" in text
    assert "…" not in text


def test_pairs_are_the_contributions_of_the_reference() -> None:
    gaussians, cam = random_gaussians(300, 3, size=0.3), camera()
    plain = Gaussians(*(value.float() for value in list(vars(gaussians).values())[:5]))
    frame, _ = draw(plain, cam, torch.zeros(3), Options())
    y, x = torch.meshgrid(torch.arange(cam.height) + 0.5, torch.arange(cam.width) + 0.5, indexing="ij")
    pixels = torch.stack([x, y], dim=-1).reshape(-1, 2).double()
    weights, _ = blend(project(gaussians, cam, False, CUTOFFS["fast"]), pixels, CUTOFFS["fast"])
    assert frame.count_pairs() == pytest.approx(int((weights > 0).sum()), abs=3)  # those on a threshold may differ


def test_other_tables_are_printed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "SCENES", (TINY,))
    monkeypatch.setattr(bench, "ERRORS", bench.Scene(50, 32, 20))
    monkeypatch.setattr(bench, "SCALING", tuple(bench.Scene(count, 64, 40) for count in (50, 100, 200, 400)))
    console = Console(file=io.StringIO(), width=80)
    bench.bench_precision(1, console)
    bench.bench_scaling(1, console)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "exact" in text
    assert "ns per pair" in text
    assert "…" not in text, "a number is cut short"
