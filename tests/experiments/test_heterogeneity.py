"""Gains and slopes with intervals, on scores whose truth is known."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aa4d.errors import InputError
from aa4d.experiments.heterogeneity import findings, report, scores_of


def rows(gain: float, per_change: float, noise: float = 0.05) -> list[dict[str, Any]]:
    """Nine scenes and three seeds of two variants; the second one gains, more where more changes."""
    rng = np.random.default_rng(4)
    found = []
    for share in (0.01, 0.02, 0.03):
        for changes in (0.2, 0.4, 0.6):
            for seed in range(3):
                base = 30 - 100 * share + rng.normal(0, noise)
                common = {
                    "capture": f"s{share}-{changes}",
                    "seed": seed,
                    "heterogeneity.active_share": share,
                    "heterogeneity.changes_per_s": changes,
                }
                more = gain + per_change * (changes - 0.4) / 0.4 + rng.normal(0, noise)
                found.append(common | {"variant": "product", "psnr_dynamic": base})
                found.append(common | {"variant": "ACFA", "psnr_dynamic": base + more})
    return found


def test_a_known_gain_and_its_slope_lie_in_their_intervals() -> None:
    (finding,) = findings(rows(gain=0.5, per_change=0.8))
    assert (finding.variant, finding.score, finding.scenes, finding.seeds) == ("ACFA", "psnr_dynamic", 9, 3)
    assert finding.gain.low < 0.5 < finding.gain.high
    over_changes, over_share = finding.slopes["changes_per_s"], finding.slopes["active_share"]
    assert over_changes.low < 0.8 < over_changes.high
    assert over_changes.low > 0.5, "from 0.2 to 0.6 the gain grows by 0.8 dB"
    assert over_share.low < 0 < over_share.high, "it does not depend on how much is active"


def test_no_gain_is_told_as_none() -> None:
    (finding,) = findings(rows(gain=0.0, per_change=0.0))
    assert finding.gain.low < 0 < finding.gain.high
    assert finding.slopes["changes_per_s"].low < 0 < finding.slopes["changes_per_s"].high


def test_only_scenes_with_every_seed_count() -> None:
    some = rows(0.5, 0.0)
    del some[1]  # ACFA, the first scene, seed 0
    scores = scores_of(some, "ACFA", "psnr_dynamic")
    assert scores is not None
    assert scores.values.shape == (8, 3)
    assert findings(some) == [], "the two have other scenes"
    assert scores_of(some[:6], "ACFA", "psnr_dynamic") is None


def test_tables_and_figures_are_written(tmp_path: Path) -> None:
    table = rows(0.5, 0.8)
    path = tmp_path / "rows.csv"
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(table[0]))
        writer.writeheader()
        writer.writerows(table)
    report(path, tmp_path / "out")
    text = (tmp_path / "out/heterogeneity.md").read_text()
    assert "## PSNR of moving pixels, dB" in text
    assert "| ACFA | +0.5" in text
    assert (tmp_path / "out/psnr_dynamic.png").stat().st_size > 10_000
    starts = {"means": "28.", "gains": "+0.5", "slopes-changes_per_s": "+0.8", "slopes-active_share": ""}
    for name, says in starts.items():
        (row,) = (r for r in csv.DictReader((tmp_path / f"out/{name}.csv").open()) if r["variant"] == "ACFA")
        assert row["psnr_dynamic"].startswith(says)
        assert row["motion_epe_px"] == ""
    first = next(csv.DictReader((tmp_path / "out/scenes.csv").open()))
    assert first == {"scene": "s0.01-0.2", "active_share": "0.01", "changes_per_s": "0.2"}


def test_variants_are_compared_with_the_one_that_is_named() -> None:
    found = {against: findings(rows(0.5, 0.0), against)[0] for against in ("product", "ACFA")}
    assert found["ACFA"].variant == "product"
    assert found["ACFA"].gain.value == pytest.approx(-found["product"].gain.value)
    with pytest.raises(InputError, match=r"--against 'acfa': the rows have 'product', 'ACFA'"):
        findings(rows(0.5, 0.0), "acfa")


def test_rows_without_indices_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    path.write_text("capture,variant,seed,psnr\n" + "".join(f"s{n},{v},0,30.5\n" for n in range(4) for v in "ab"))
    with pytest.raises(InputError, match=r"s0: its rows lack heterogeneity.active_share; render it with the"):
        report(path, tmp_path / "out")
    path.write_text("capture,variant,seed,psnr\ns,a,0,30.5\n")
    with pytest.raises(InputError, match="needs two variants with scores of three scenes or more"):
        report(path, tmp_path / "out")
    assert not (tmp_path / "out").exists()
