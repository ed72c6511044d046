"""The cost report: its graph, its numbers, its page, and what is refused."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import pytest

from aa4d import cli
from aa4d.cost import PANELS, expected, panel_of
from aa4d.cost.panel import SIZES, Setup
from aa4d.cost.rows import rows_of, span
from aa4d.files import claimed
from aa4d.graph.task import in_order
from tests.browser import launched, watched
from tests.cost import hyperbola

BUILT_IN = tuple(PANELS)


@pytest.fixture(autouse=True)
def panels(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("hyperbola", "broken", "absent"):
        monkeypatch.setitem(PANELS, name, f"tests.cost.{name}")
    hyperbola.ran.clear()


def command(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    """`aa4d cost` in this process; its exit code."""
    monkeypatch.setattr(sys, "argv", ["aa4d", "cost", *map(str, arguments)])
    try:
        cli.main()
    except SystemExit as end:
        return int(end.code or 0)
    return 0


def test_rows_have_the_numbers_of_a_closed_form_and_its_front() -> None:
    panel = panel_of("hyperbola")
    found = [p for s in hyperbola.SECONDS for p in hyperbola.points({"seconds": s, "error": 1 / s})]
    rows = rows_of("hyperbola", panel, found)
    assert [row["point"] for row in rows if row["on_front"]] == ["0.1 s", "1 s", "4 s"]
    assert [row["point"] for row in rows if row["default"]] == ["1 s"]
    assert all(row["quality"] * row["processor_s"] == pytest.approx(1) for row in rows if row["on_front"])
    assert {row["better"] for row in rows} == {"lower"}


def test_the_command_writes_json_csv_and_a_page_that_say_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert command(monkeypatch, "--out", tmp_path / "out", "--panels", "hyperbola", "absent") == 0
    report = json.loads((tmp_path / "out/cost.json").read_text())
    with (tmp_path / "out/cost.csv").open() as file:
        table = list(csv.DictReader(file))
    assert [row["point"] for row in table] == [row["point"] for row in report["rows"]]
    assert float(table[0]["inverse"]) == pytest.approx(0.1)
    assert table[1]["default"] == "True"
    assert report["machine"]["threads"] >= 1
    page = (tmp_path / "out/cost.html").read_text()
    assert "Absent: the moon is not here" in page
    assert page.count('class="default">1 s (default)') == 1
    assert "http" not in page.replace("http-equiv", "")  # nothing is fetched


def test_a_second_command_measures_nothing_again_and_another_panel_only_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for _ in range(2):
        assert command(monkeypatch, "--out", tmp_path / "out", "--panels", "hyperbola") == 0
    assert hyperbola.ran == list(hyperbola.SECONDS)
    assert command(monkeypatch, "--out", tmp_path / "out", "--panels", "hyperbola", "broken") == 2
    assert hyperbola.ran == [*hyperbola.SECONDS, -1]


def test_a_point_that_fails_is_said_and_the_others_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(monkeypatch, "--out", tmp_path / "out", "--panels", "broken") == 2
    assert "time runs forwards" in capsys.readouterr().err
    report = json.loads((tmp_path / "out/cost.json").read_text())
    assert report["failed"]["broken"] == ["time runs forwards; give it a positive number"]
    assert [row["point"] for row in report["rows"]] == ["0.1 s", "1 s", "wasteful", "4 s"]


def test_a_plan_says_how_long_and_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(monkeypatch, "--out", tmp_path / "out", "--panels", "hyperbola", "absent", "--plan") == 0
    said = capsys.readouterr().out
    assert "3 of 3 tasks to do, 1 at a time: about 5.1 s" in said
    assert "absent is left out: the moon" in said
    assert not (tmp_path / "out").exists()
    assert not hyperbola.ran


def test_bad_input_is_refused_in_a_sentence_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    wrong = {
        "--panels must be one of": ("--panels", "hyperbole"),
        "exclude each other": ("--quick", "--full"),
        "no panel can be measured here": ("--panels", "absent"),
        "--costs nowhere: no such folder": ("--panels", "hyperbola", "--costs", "nowhere"),
        "no such capture folder": ("--panels", "training-iterations", "--capture", tmp_path / "nowhere"),
    }
    for sentence, arguments in wrong.items():
        assert command(monkeypatch, "--out", out, *arguments) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert all(word in said for word in sentence.split(" must be one of")), said
        assert not out.exists()


def test_a_folder_in_use_or_of_something_else_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters/one.txt").write_text("dear")
    assert command(monkeypatch, "--out", tmp_path / "letters", "--panels", "hyperbola") == 2
    refused = capsys.readouterr().err
    assert "not empty and not a cost report" in refused
    assert command(monkeypatch, "--out", tmp_path / "letters", "--panels", "hyperbola", "--plan") == 2
    assert capsys.readouterr().err == refused
    assert command(monkeypatch, "--out", tmp_path / "out", "--panels", "hyperbola") == 0
    assert command(monkeypatch, "--out", tmp_path / "out", "--panels", "hyperbola", "--full") == 2
    assert "with other settings" in capsys.readouterr().err
    with claimed(tmp_path / "out", "something"):
        assert command(monkeypatch, "--out", tmp_path / "out", "--panels", "hyperbola") == 2
    assert str(tmp_path / "out") in capsys.readouterr().err


def test_without_blender_what_needs_it_is_left_out_with_the_way_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("aa4d.cost.inputs.blender_is_here", lambda: False)
    asked = ("--panels", "synthesis-traffic", "training-iterations")
    assert command(monkeypatch, "--out", tmp_path / "out", *asked) == 2
    assert "Blender is not here: put `blender` on PATH" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert command(monkeypatch, "--out", tmp_path / "out", *asked, "hyperbola") == 0
    left_out = json.loads((tmp_path / "out/cost.json").read_text())["left_out"]
    assert list(left_out) == ["synthesis-traffic", "training-iterations"]
    assert "--capture" in left_out["training-iterations"]
    assert panel_of("training-iterations").missing(Setup(SIZES["quick"], Path("a-capture"))) is None


def test_quick_is_expected_to_take_at_most_fifteen_minutes_and_full_hours() -> None:
    seconds = {}
    for name, size in SIZES.items():
        measurements = [m for panel in BUILT_IN for m in panel_of(panel).measurements(Setup(size))]
        tasks = in_order(m.task for m in measurements)
        costs = expected.costs(tasks, name, [])
        seconds[name] = sum(costs.seconds(task) or 0 for task in tasks)
    assert 300 < seconds["quick"] <= 900
    assert seconds["full"] > 3600


def test_every_panel_is_whole() -> None:
    for name in PANELS:
        panel = panel_of(name)
        assert all((panel.title, panel.per)), name
        for sentence in (panel.varied, panel.measured):
            assert sentence.endswith("."), name


@pytest.mark.parametrize(("seconds", "text"), [(7200, "2 h"), (90, "1.5 min"), (2.5, "2.5 s"), (0.0125, "12.5 ms")])
def test_times_are_written_with_a_fitting_unit(seconds: float, text: str) -> None:
    assert span(seconds) == text


def test_the_page_opens_in_a_browser_with_its_plots_and_asks_for_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert command(monkeypatch, "--out", tmp_path / "out", "--panels", "hyperbola") == 0
    with launched() as browser, watched(browser, 1000, 800) as seen:
        seen.page.goto((tmp_path / "out/cost.html").as_uri())
        points = seen.page.locator(".plot > svg circle")
        assert points.count() == len(hyperbola.SECONDS) + 1, "and one that is beaten; the star is no circle"
        assert seen.page.locator(".plot svg text.label").all_inner_texts()
        default = seen.page.locator("td.default").first
        assert default.inner_text() == "1 s (default)"
        assert default.evaluate("cell => getComputedStyle(cell).fontWeight") == "700"
        seen.page.locator("a", has_text="Hyperbola").click()
        assert seen.page.url.endswith("#hyperbola")
        assert not seen.errors
        assert not seen.requests
