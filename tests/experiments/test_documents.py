"""Measured tables: every page is current, and a table is refused that names no command."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from aa4d.errors import InputError
from aa4d.experiments.documents import nested, record, render, rendered
from aa4d.experiments.outputs import rows_of

DOCS = Path(__file__).parents[2] / "docs"
PAGES = sorted(DOCS.glob("*.md"))

TABLE: dict[str, Any] = {
    "command": "aa4d bench raster --json raster.json",
    "date": "2026-11-22",
    "machine": "two threads",
    "load": "0.9",
    "note": "The best of 7.",
    "columns": {"Gaussians": "{gaussians:,}", "image": "{width}x{height}", "ms": "{ms:.1f}"},
    "rows": [{"gaussians": 10_000, "width": 48, "height": 27, "ms": 2.55}],
}
PAGE = "# Speed\n\n<!-- measured: raster -->\nold\n<!-- end -->\n\nThe end.\n"


def documents(folder: Path, page: str = PAGE, **changed: Any) -> Path:
    (folder / "measured").mkdir()
    (folder / "measured" / "raster.json").write_text(json.dumps({**TABLE, **changed}))
    (folder / "page.md").write_text(page)
    return folder


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_page_shows_the_tables_of_docs_measured(page: Path) -> None:
    assert page.read_text() == rendered(page), "run `python -m aa4d.experiments.documents render`"


def test_every_measured_table_is_shown_in_a_page() -> None:
    shown = {name for page in PAGES for name in re.findall(r"<!-- measured: (\S+) -->", page.read_text())}
    assert shown == {path.stem for path in (DOCS / "measured").glob("*.json")}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_table_under_measured_is_written_by_hand(page: Path) -> None:
    for section in re.findall(r"^## Measured$(.*?)(?=^## |\Z)", page.read_text(), re.DOTALL | re.MULTILINE):
        by_hand = re.sub(r"<!-- measured: .*?<!-- end -->", "", section, flags=re.DOTALL)
        assert not re.search(r"^\|", by_hand, re.MULTILINE)


@pytest.mark.parametrize("page", [*PAGES, *DOCS.parent.glob("*.md")], ids=lambda page: page.name)
def test_links_between_pages_lead_somewhere(page: Path) -> None:
    for target, anchor in re.findall(r"\]\(([^):#\s]*)(?:#([^)\s]*))?\)", page.read_text()):
        other = page.parent / target if target else page
        assert other.exists(), target
        if anchor:
            headings = re.findall(r"^#+ (.*)$", other.read_text(), re.MULTILINE)
            assert anchor in [re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings]


def test_a_page_gets_its_table_with_command_machine_and_load(tmp_path: Path) -> None:
    docs = documents(tmp_path)
    render(docs)
    assert (docs / "page.md").read_text() == (
        "# Speed\n\n<!-- measured: raster -->\n\n| Gaussians | image | ms |\n| --- | --- | --- |\n"
        "| 10,000 | 48x27 | 2.5 |\n\n"
        "`aa4d bench raster --json raster.json`; 2026-11-22, two threads, load average 0.9. The best of 7.\n"
        "<!-- end -->\n\nThe end.\n"
    )
    assert rendered(docs / "page.md") == (docs / "page.md").read_text()


def test_a_value_that_a_row_lacks_leaves_its_cell_empty(tmp_path: Path) -> None:
    columns = {"": "{ms:.1f}", "alex": "{lpips[alex]:.3f}", "vgg": "{lpips[vgg]:.3f}", "none": "{none:.1f}"}
    docs = documents(tmp_path, columns=columns, rows=[{"lpips": {"alex": 0.1234}, "none": None}])
    assert "|  | 0.123 |  |  |" in rendered(docs / "page.md")


def test_a_table_without_a_command_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"raster.json: 'command' is empty; name the command"):
        render(documents(tmp_path, command=""))


def test_a_table_that_lacks_a_key_is_refused(tmp_path: Path) -> None:
    docs = documents(tmp_path)
    del (table := dict(TABLE))["load"]
    (docs / "measured" / "raster.json").write_text(json.dumps(table))
    with pytest.raises(InputError, match=r"key 'load' is missing; a measured table has columns, command, date"):
        render(docs)


@pytest.mark.parametrize(
    ("page", "sentence"),
    [
        (PAGE.replace("raster", "other"), r"other.json: not found; expected a measured table"),
        (PAGE.replace("<!-- end -->", ""), "stand in pairs"),
        (PAGE + "<!-- end -->", "stand in pairs"),
        ("<!-- measured: raster -->\n" + PAGE, "stand in pairs"),
    ],
)
def test_a_marker_without_its_table_or_its_other_half_is_refused(tmp_path: Path, page: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        render(documents(tmp_path, page))
    assert (tmp_path / "page.md").read_text() == page


def test_recording_takes_what_the_columns_show_from_the_output(tmp_path: Path) -> None:
    docs = documents(tmp_path)
    output = tmp_path / "raster.json"
    output.write_text(json.dumps([{"gaussians": 500, "width": 8, "height": 4, "ms": 0.75, "threads": 2}]))
    record("raster", (output,), load="1.2", machine="one thread", docs=docs)
    table = json.loads((docs / "measured" / "raster.json").read_text())
    assert table["rows"] == [{"gaussians": 500, "width": 8, "height": 4, "ms": 0.75}]
    assert (table["load"], table["machine"], table["command"]) == ("1.2", "one thread", TABLE["command"])
    assert "| 500 | 8x4 | 0.8 |" in (docs / "page.md").read_text()


def test_recording_refuses_an_output_of_something_else(tmp_path: Path) -> None:
    docs, output = documents(tmp_path), tmp_path / "table.csv"
    output.write_text("variant,PSNR\nplain,20.0\n")
    with pytest.raises(InputError, match="a column shows 'gaussians', which no output has"):
        record("raster", (output,), load="1", docs=docs)
    assert json.loads((docs / "measured" / "raster.json").read_text()) == TABLE


def test_keys_with_a_dot_are_shown_by_their_parts() -> None:
    row = {"psnr": 30.5, "lpips.alex": 0.1, "lpips.vgg": 0.2}
    assert nested(row) == {"psnr": 30.5, "lpips": {"alex": 0.1, "vgg": 0.2}}


def test_rows_are_read_from_all_that_commands_write(tmp_path: Path) -> None:
    table, growth, metrics = (tmp_path / name for name in ("table.csv", "growth.json", "metrics.json"))
    table.write_text("variant,seeds,PSNR,LPIPS\nplain,3,20.50,\nfancy,3,21.0 ±0.1,0.2\n")
    assert rows_of(table) == [
        {"variant": "plain", "seeds": 3, "PSNR": "20.50", "LPIPS": None},
        {"variant": "fancy", "seeds": 3, "PSNR": "21.0 ±0.1", "LPIPS": 0.2},
    ]
    growth.write_text('{"threads": 2, "growth": [{"anchors": 1000}]}')
    assert rows_of(growth) == [{"anchors": 1000}]
    metrics.write_text('{"psnr": 30.5}')
    assert rows_of(metrics) == [{"run": tmp_path.name, "psnr": 30.5}]
    table.write_text("")
    with pytest.raises(InputError, match="holds no rows"):
        rows_of(table)
