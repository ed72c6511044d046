"""`aa4d bench train`: what it writes and prints, on a workload of a moment."""

import json
from pathlib import Path

import pytest
from rich.console import Console

from aa4d.training.bench import PARTS, Workload, bench


def test_the_benchmark_writes_its_keys_and_a_readable_table(tmp_path: Path) -> None:
    small = Workload(60, 64, 36)
    path = tmp_path / "bench.json"
    console = Console(width=80, record=True)
    result = bench(path, console, standard=small, growth=(small, Workload(120, 64, 36)), seconds=0.0)
    assert json.loads(path.read_text()) == result
    assert abs(int(str(result["anchors"])) - 60) <= 6  # a grid of whole rows
    assert result["iterations_per_second"] == pytest.approx(1e3 / float(str(result["iteration_ms"])))
    assert float(str(result["render_fps"])) > 0
    assert float(str(result["peak_mib"])) > 50
    processor = result["processor_ms"]
    assert isinstance(processor, dict)
    assert set(processor) == {"float32", "bfloat16"}
    assert min(processor.values()) > 0
    parts = result["parts"]
    assert isinstance(parts, dict)
    assert sum(parts.values()) == pytest.approx(1)
    assert all(parts[name] > 0 for name in PARTS)  # no kernel was renamed without its part
    growth = result["growth"]
    assert isinstance(growth, list)
    assert [row["anchors"] > 90 for row in growth] == [False, True]
    lines = console.export_text().splitlines()
    assert max(len(line) for line in lines) <= 80
    assert not any("…" in line for line in lines)
