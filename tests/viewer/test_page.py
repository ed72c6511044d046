"""The page in a real browser: it shows what the rasteriser draws, and follows mouse, keys and panel."""

import io
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

pytest.importorskip("viser")
pytest.importorskip("playwright")

from aa4d.viewer.cameras import Eye, fov_that_shows
from aa4d.viewer.drawing import Drawing
from aa4d.viewer.following import Followed
from aa4d.viewer.page import Page
from aa4d.viewer.pictures import Painter, Wanted
from aa4d.viewer.seat import Seat
from aa4d.viewer.server import serve
from tests.browser import Watched, launched, watched

WIDTH, HEIGHT = 640, 360
LONG_S = 120.0  # software WebGL on a machine that does much else
CANVAS = "canvas"
CANVAS_ALONE = "body > * > * { visibility: hidden !important } canvas { visibility: visible !important }"


@pytest.fixture(scope="module")
def page(toy_run: Path) -> Iterator[Page]:
    shown = Followed(toy_run, None).load()
    drawing = Drawing((shown, Followed(toy_run, None).load()))
    server = serve("127.0.0.1", 0)
    page = Page(server, drawing)
    drawing.start()
    yield page
    drawing.stop()
    server.stop()


@pytest.fixture(scope="module")
def window(page: Page) -> Iterator[Watched]:
    """A browser that has the page open and shows a first picture."""
    address = f"127.0.0.1:{page.server.get_port()}"
    with launched() as browser, watched(browser, WIDTH, HEIGHT, allowed=address) as seen:
        seen.page.goto(f"http://{address}")
        seen.page.wait_for_selector(CANVAS, timeout=LONG_S * 1e3)
        until(lambda: bool(page._seats), "no browser has arrived")
        yield seen


def until(condition: Callable[[], bool], otherwise: str) -> None:
    deadline = time.monotonic() + LONG_S
    while not condition():
        assert time.monotonic() < deadline, otherwise
        time.sleep(0.1)


def seat_of(page: Page) -> Seat:
    return next(iter(page._seats.values()))


def wanted(page: Page) -> Wanted:
    return page.wanted(seat_of(page), time.monotonic())[0]


def expected(page: Page) -> NDArray[np.uint8]:
    return Painter().picture(page.drawing.shown, wanted(page), WIDTH, HEIGHT).pixels


def screenshot(window: Watched) -> NDArray[np.uint8]:
    return np.array(Image.open(io.BytesIO(window.page.screenshot(style=CANVAS_ALONE))).convert("RGB"))


def check_it_shows(window: Watched, page: Page) -> None:
    """The browser shows what the rasteriser draws of what is wanted, but for what JPEG changes."""
    deadline, apart = time.monotonic() + LONG_S, np.inf
    while apart > 3 and time.monotonic() < deadline:
        time.sleep(0.2)
        apart = np.abs(screenshot(window).astype(float) - expected(page)).mean()
    assert apart < 3, f"{apart:.1f} of 255 apart"


def test_it_begins_where_the_first_frame_was_taken(window: Watched, page: Page) -> None:
    loaded = page.drawing.shown[0].loaded
    start = wanted(page)
    np.testing.assert_array_equal(start.eye.viewmat, loaded.frames[0].viewmat)
    assert start.eye.fov == pytest.approx(fov_that_shows(loaded.camera, WIDTH / HEIGHT))
    assert start.second == loaded.frames[0].time_s
    check_it_shows(window, page)
    browser = seat_of(page).client.camera
    assert Eye(loaded.frames[0].viewmat, 1.0).center() == pytest.approx(browser.position, abs=1e-3)


def test_a_drag_orbits_and_the_picture_follows(window: Watched, page: Page) -> None:
    before, sent = wanted(page).eye, time.monotonic()
    window.page.mouse.move(150, 300)
    window.page.mouse.down()
    for step in range(1, 6):
        window.page.mouse.move(150 + 12 * step, 300 - 10 * step)
    window.page.mouse.up()
    until(lambda: not wanted(page).eye.is_seen_from(before, 1e-3), "the camera did not move")
    until(lambda: time.monotonic() - sent > 2, "")  # damping
    target = seat_of(page).client.camera.look_at
    for eye in (before, wanted(page).eye):  # an orbit keeps its distance
        assert np.linalg.norm(eye.center() - target) == pytest.approx(20.0, rel=0.2)
    check_it_shows(window, page)


def test_keys_step_through_frames_and_layers(window: Watched, page: Page) -> None:
    frames = page.drawing.shown[0].loaded.frames
    window.page.keyboard.press("n")
    until(lambda: wanted(page).second == frames[1].time_s, "N did not show the next frame")
    check_it_shows(window, page)
    window.page.keyboard.press("l")
    until(lambda: wanted(page).layer == "depth", "L did not show the next layer")
    check_it_shows(window, page)


def test_the_panel_scrubs_plays_and_compares(window: Watched, page: Page) -> None:
    window.page.keyboard.press("v")  # the second model
    window.page.keyboard.press("v")  # side by side
    until(lambda: wanted(page).arrangement == "side by side", "V did not go on")
    check_it_shows(window, page)
    before = wanted(page).second
    window.page.keyboard.press("Space")
    until(lambda: wanted(page).second != before, "nothing plays")
    window.page.keyboard.press("Space")
    until(lambda: not page._playing.is_running, "it plays on")
    slider = window.page.get_by_role("slider").first
    slider.focus()
    before = wanted(page).second
    window.page.keyboard.press("Home")
    until(lambda: wanted(page).second == 0, f"the slider left it at {before}")
    check_it_shows(window, page)


def test_error_flies_to_the_frames_and_a_drag_ends_the_flight(window: Watched, page: Page) -> None:
    page._show.value, page._layer.value = page._choices[0].name, "error"
    assert page._fly.value
    page._step(3)
    frame = page.drawing.shown[0].loaded.frames[3]
    np.testing.assert_array_equal(wanted(page).eye.viewmat, frame.viewmat)
    check_it_shows(window, page)
    until(lambda: np.allclose(seat_of(page).client.camera.position, wanted(page).eye.center(), atol=0.01), "no flight")
    time.sleep(1)
    assert page._fly.value  # the browser's echo of its own flight does not end it
    window.page.mouse.move(150, 300)
    window.page.mouse.down()
    window.page.mouse.move(210, 250, steps=4)
    window.page.mouse.up()
    until(lambda: not page._fly.value, "it flies on")


def test_shift_and_a_click_choose_what_to_orbit(window: Watched, page: Page) -> None:
    page._go_to(page.drawing.shown[0].loaded.frames[0], seat_of(page).client)
    page._layer.value = "color"
    check_it_shows(window, page)
    before = seat_of(page).client.camera.look_at
    window.page.mouse.move(WIDTH * 0.3, HEIGHT * 0.7)
    window.page.keyboard.down("Shift")
    window.page.mouse.click(WIDTH * 0.3, HEIGHT * 0.7)
    window.page.keyboard.up("Shift")
    until(lambda: not np.allclose(seat_of(page).client.camera.look_at, before, atol=0.5), "nothing to orbit")
    assert seat_of(page).client.camera.look_at[0] < before[0] - 1  # to the left


def test_cameras_are_there_to_click(window: Watched, page: Page) -> None:
    page._go_to(page.drawing.shown[0].loaded.frames[0], seat_of(page).client)
    check_it_shows(window, page)
    page._cameras.value = True
    assert all(frustum.visible for frustum in page._frustums)
    page._goes_to(page.drawing.shown[0].loaded.frames[4])(Event(seat_of(page).client))
    assert wanted(page).second == page.drawing.shown[0].loaded.frames[4].time_s
    page._cameras.value = False
    check_it_shows(window, page)


def test_another_model_on_disk_is_shown(window: Watched, page: Page, toy_run: Path) -> None:
    page.replace(0, Followed(toy_run, None).load())
    check_it_shows(window, page)


def test_a_run_that_is_gone_keeps_its_picture_and_the_panel_says_so(window: Watched, page: Page, toy_run: Path) -> None:
    page.warn(0, "run: no such folder; the page keeps what it showed")
    window.page.get_by_text("the page keeps what it showed").wait_for(timeout=LONG_S * 1e3)
    check_it_shows(window, page)
    page.replace(0, Followed(toy_run, None).load())
    window.page.get_by_text("the page keeps what it showed").wait_for(state="detached", timeout=LONG_S * 1e3)


def test_it_asked_nobody_else_and_nothing_went_wrong(window: Watched, page: Page) -> None:
    assert window.requests == []
    assert [e for e in window.errors if "deprecated" not in e and "GPU stall" not in e] == []
    assert page.server.request_share_url() is None


class Event:
    def __init__(self, client: Any) -> None:
        self.client = client
