"""The add-on's benchmark, on a model so small that its times mean nothing."""

import json
import subprocess
import sys
from pathlib import Path

from model_files import make_model, write_model

SCRIPT = Path(__file__).resolve().parent.parent.parent / "addon" / "bench_addon.py"


def test_rows_have_what_is_asked_for(extension_zip: Path, tmp_path: Path) -> None:
    model, out = write_model(tmp_path / "model.safetensors", *make_model(50)), tmp_path / "rows.json"
    command = [sys.executable, str(SCRIPT), "--extension", str(extension_zip), "--json", str(out)]
    done = subprocess.run(
        [*command, "--anchors", "60", "--model", str(model)], capture_output=True, text=True, timeout=200, check=False
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(out.read_text())
    assert [(row["points"], row["carrier"]) for row in result["rows"]] == [(60, "anchors"), (600, "gaussians")]
    times = {
        "import_s",
        "field_ms",
        "decode_ms",
        "copy_ms",
        "live_ms",
        "live_processor_ms",
        "exact_ms",
        "exact_processor_ms",
        "playing_ms",
        "playing_processor_ms",
        "live_again_ms",
        "bare_ms",
        "baked_ms",
        "baked_processor_ms",
        "cycles_s",
    }
    for row in result["rows"]:
        assert all(row[name] > 0 for name in times)
        assert row["blend_mb_a_frame"] > 0
    errors = [row["mean_mm"] for row in result["accuracy"][1:5]]
    assert errors == sorted(errors)
    assert errors[0] < errors[3]
    assert "| points | carrier |" in done.stdout
