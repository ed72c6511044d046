"""Pages of results: what they hold, that no text becomes markup, and what they do when they are used in a browser."""

import io
import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page

from aa4d.reports.page import (
    Cell,
    Code,
    Column,
    Links,
    Loop,
    Pictures,
    Section,
    Slider,
    Table,
    Text,
    View,
    html_of,
    write_page,
)
from aa4d.reports.pictures import Detail, cut_out, loop_of, picture_of
from aa4d.reports.plot import Plot, Series
from tests.browser import Watched, launched, watched

HOSTILE = "</title></script><script>window.stolen = 1</script>'\"><img src=x onerror=window.stolen=1>{{ 7 * 7 }}"
DETAIL = Detail(320, 90, 4, 320)
WIDTH, HEIGHT = 160, 90


def shade(value: int) -> np.ndarray:
    return np.full((HEIGHT, WIDTH, 3), value, np.uint8)


def sections(name: str = "name") -> list[Section]:
    """One of each part, every text of which is `name` where that says nothing else."""
    columns = [Column("method", is_number=False), Column("PSNR", 2, good=1, hint=name), Column("steps", 0)]
    rows = [(name, 9.5, 7), ("b", None, 100), ("c", 10.25, 20), ("d", Cell("-3.00 ±1", -3.0, "best"), None)]
    points = [(1.0, 2.0), (10.0, math.nan), (100.0, 3.0)]
    pictures = [picture_of(shade(v), DETAIL, f"{name} {v}", name) for v in (0, 128, 255)]
    views = (
        View(f"{name} 0", (pictures[0], pictures[1], pictures[2]), f"note {name} 0"),
        View("1", (pictures[2], pictures[0], None), "note 1"),
    )
    moments = [[shade(v), shade(255 - v)] for v in (0, 90, 180)]
    moving, still = loop_of(moments, [0.2, 0.2, 0.2], 2, DETAIL, name)
    return [
        Section(name, [Text(name, "warning"), Table(columns, rows, name), Code(name, name)], name),
        Section("Plots", [Plot(name, name, name, [Series(name, points, line=True), Series("b", points, star=True)])]),
        Section("Names", [Plot("p", "", "y", [Series("s", [(0, 1), (1, 2)], notes=[name, name])], names=[name, "b"])]),
        Section("Frames", [Slider((name, "render", "other"), views), Loop(moving, still, (name, "render"), 2, name)]),
        Section("Cut out", [Pictures((cut_out(shade(9), (0, 0, 40, 30), 80, name, name),) * 3, 3)], folded=True),
        Section("Files", [Links(((name, "table.md"),))]),
        Section("without parts", []),
    ]


def test_a_page_is_one_file_that_says_its_size_and_asks_for_nothing(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    write_page(path, "Title", sections(), lead="what it is")
    html = path.read_text("utf-8")
    said = re.search(r"One file of ([\d.]+) MB", html)
    assert said is not None
    assert float(said[1]) == pytest.approx(path.stat().st_size / 1e6, abs=0.006)
    sources = re.findall(r'\ssrc="([^"]*)"', html)
    assert len(sources) == 5 + 2 + 3
    assert all(source.startswith("data:image/webp;base64,") for source in sources)
    assert re.findall(r'href="([^"]*)"', html) == ["table.md"]
    assert "without parts" not in html
    assert html.count("<img") == len(re.findall(r'<img[^>]* alt="[^"]+"', html))


def test_no_text_becomes_markup() -> None:
    html = html_of(HOSTILE, sections(HOSTILE), lead=HOSTILE, reduced=HOSTILE)
    assert "window.stolen" in html
    assert "<script>window.stolen" not in html
    assert "<img src=x" not in html
    assert html.count("<script") == html.count("</script>") == 1
    assert html.count("</title>") == 1 + html.count("<title>") - 1
    assert "49" not in re.sub(r'src="[^"]*"|[dx]="[^"]*"', "", html).split("<footer")[1]


@pytest.mark.parametrize(
    ("value", "text", "key"),
    [
        (3, "3.00", "3.0"),
        (None, "", None),
        (math.nan, "", None),
        (math.inf, "inf", "Infinity"),
        (-math.inf, "-inf", "-Infinity"),
        ("text", "text", None),
        (Cell("3 ±1", 3.0), "3 ±1", "3.0"),
    ],
)
def test_a_cell_is_written_and_sorted_by_its_number(value: object, text: str, key: str | None) -> None:
    cell = Table([Column("a", 2)], [[value]]).cells[0][0]  # type: ignore[list-item]
    assert (cell.text, cell.sort_key) == (text, key)


def test_a_plot_leaves_a_gap_where_there_is_no_number_and_says_where_nothing_is() -> None:
    gap = Plot("", "x", "y", [Series("s", [(0, 1), (1, 2), (2, math.nan), (3, 1), (4, 2)], line=True, dots=False)])
    assert len(re.findall(r'<path d="M[^"]*L', gap.svg)) == 2
    nothing = Plot("", "x", "y", [Series("s", [(0, math.inf), (-1, 2)])], log_x=True)
    assert nothing.svg == '<p class="note">nothing to draw</p>'
    one = Plot("", "x", "y", [Series("s", [(2, 5)])])
    assert '<circle cx="305.0"' in one.svg  # in the middle between the margins


def test_a_log_axis_puts_equal_ratios_at_equal_distances() -> None:
    plot = Plot("", "x", "y", [Series("s", [(1, 0), (10, 0), (100, 0)])], log_x=True)
    a, b, c = (float(x) for x in re.findall(r'<circle cx="([\d.]+)"', plot.svg))
    assert b - a == pytest.approx(c - b, abs=0.2)
    up = Plot("", "x", "y", [Series("s", [(0, 1e-6), (0, 1e-3), (0, 1), (0, 0)])], log_y=True)
    a, b, c = (float(y) for y in re.findall(r'cy="([\d.]+)"', up.svg))  # zero has no logarithm
    assert b - a == pytest.approx(c - b, abs=0.2)
    assert c < a


def test_labels_stand_beside_their_points_inside_of_the_plot() -> None:
    plot = Plot("", "x", "y", [Series("s", [(0, 0), (1, 1)], labels=("left", "a long name at the right"))])
    assert re.findall(r'<text class="label"[^>]*text-anchor="(\w+)">([^<]*)<', plot.svg) == [
        ("start", "left"),
        ("end", "a long name at the right"),
    ]


def test_pictures_are_never_enlarged_and_fit_what_is_asked_for() -> None:
    small = picture_of(shade(1), Detail(80, 90, 1, 80), "a")
    assert (small.width, small.height) == (80, 45)
    same = picture_of(shade(1), Detail(1000, 90, 1, 80), "a")
    assert (same.width, same.height) == (WIDTH, HEIGHT)
    moving, still = loop_of([[shade(1)] * 3, [shade(2)] * 3], [0.1, 0.1], 3, Detail(80, 90, 1, 90), "a")
    assert (moving.width, moving.height) == (still.width, still.height) == (90, 17)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with launched() as browser:
        yield browser


@pytest.fixture
def seen(browser: Browser, tmp_path: Path) -> Iterator[Watched]:
    """A page full of hostile texts, opened; in the end nothing was an error, went to a network or ran a text."""
    path = tmp_path / "page.html"
    write_page(path, HOSTILE, sections(HOSTILE), lead=HOSTILE)
    with watched(browser, 900, 700) as seen:
        seen.page.set_default_timeout(120_000)
        seen.page.goto(path.as_uri())
        yield seen
        assert seen.page.evaluate("window.stolen === undefined")
        assert (seen.errors, seen.requests) == ([], [])


def column(page: Page, number: int) -> list[str]:
    return page.locator(f"tbody tr td:nth-child({number})").all_inner_texts()


def test_a_click_on_a_heading_sorts_numbers_as_numbers_and_blanks_last(seen: Watched) -> None:
    page = seen.page
    psnr, steps = page.get_by_role("button", name="PSNR"), page.get_by_role("button", name="steps")
    psnr.click()  # more is better: the best first
    assert column(page, 2) == ["10.25", "9.50", "-3.00 ±1", ""]
    assert page.locator("th").nth(1).get_attribute("aria-sort") == "descending"
    psnr.click()
    assert column(page, 2) == ["-3.00 ±1", "9.50", "10.25", ""]
    steps.focus()
    page.keyboard.press("Enter")
    assert column(page, 3) == ["7", "20", "100", ""]
    assert page.locator("th").nth(1).get_attribute("aria-sort") == "none"
    page.get_by_role("button", name="method").click()
    assert column(page, 1)[1:] == ["b", "c", "d"]


def test_the_slider_moves_by_pointer_and_keyboard(seen: Watched) -> None:
    page = seen.page
    stage, handle = page.locator(".stage"), page.get_by_role("slider")
    at = "(e) => parseFloat(getComputedStyle(e).getPropertyValue('--at'))"
    assert stage.evaluate(at) == 50
    handle.focus()
    page.keyboard.press("ArrowRight")
    assert stage.evaluate(at) == 51
    page.keyboard.press("Home")
    assert stage.evaluate(at) == 0
    box = stage.bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + box["height"] / 2)
    assert stage.evaluate(at) == pytest.approx(75, abs=2)
    clip = page.locator(".drawn.right").evaluate("(e) => getComputedStyle(e).clipPath")
    assert re.fullmatch(r"inset\(0(px)? 0(px)? 0(px)? 7[3-7]%\)", clip)


def test_the_slider_shows_the_pictures_and_the_frame_that_are_chosen(seen: Watched) -> None:
    page = seen.page
    shown = "(es) => es.map((e) => [e.dataset.view, e.dataset.which])"
    assert page.locator(".drawn.left").evaluate_all(shown) == [["0", "0"]]
    page.locator("select[name=right]").select_option("2")
    assert page.locator(".drawn.right").evaluate_all(shown) == [["0", "2"]]
    assert page.locator(".tag.right").inner_text() == "other"
    page.locator("select[name=view]").select_option("1")
    assert page.locator(".drawn.right").inner_text() == "no picture"
    assert page.locator("[data-note]:visible").all_inner_texts() == ["note 1"]
    page.locator("select[name=left]").select_option("2")  # the same on both sides
    assert page.locator(".drawn.left").evaluate_all(shown) == [["1", "2"]]
    assert page.locator(".drawn.right").count() == 0
    assert page.locator(".tag.left").inner_text() == "other"


def test_a_loop_is_held_still_by_a_click_and_for_who_wants_less_motion(seen: Watched) -> None:
    page = seen.page
    assert page.locator(".moving").is_visible()
    page.get_by_role("button", name="Hold still").click()
    assert page.locator(".still").is_visible()
    assert not page.locator(".moving").is_visible()
    page.get_by_role("button", name="Play").click()
    assert page.locator(".moving").is_visible()
    page.emulate_media(reduced_motion="reduce")
    page.reload()
    assert page.locator(".still").is_visible()


def test_texts_stand_as_they_are_and_pictures_are_whole(seen: Watched) -> None:
    page = seen.page
    assert page.title() == HOSTILE
    assert page.locator("h1").inner_text() == HOSTILE
    assert column(page, 1)[0] == HOSTILE
    page.get_by_text("Cut out").click()
    loaded = page.locator("img").evaluate_all(
        "(es) => Promise.all(es.map((e) => e.decode().then(() => e.naturalWidth)))"
    )
    assert min(loaded) > 0
    width = page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
    assert width[0] <= width[1]  # only tables scroll sideways


def test_colors_follow_the_system(seen: Watched) -> None:
    page = seen.page
    brightness = {}
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        shot = np.array(Image.open(io.BytesIO(page.screenshot())).convert("L"))
        brightness[scheme] = np.median(shot)
    assert brightness["light"] > 240
    assert brightness["dark"] < 40


def test_a_number_that_is_rounded_to_zero_has_no_sign() -> None:
    table = Table([Column("gain", 2), Column("gain")], [[-0.004, -0.0], [-0.006, -0.25]])
    assert [[cell.text for cell in row] for row in table.cells] == [["0.00", "0"], ["-0.01", "-0.25"]]
