"""The page that plays a scene: what it holds, what a browser shows of it, and that no name becomes a script."""

import base64
import io
import json
import re
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Browser, Page

from aa4d.errors import InputError
from aa4d.export import export
from aa4d.export.clip import FAINTEST, Clip, every_gaussian
from aa4d.export.html_page import NAME, PLAYER, Attribute, packed_keys, page_of, rounded
from aa4d.filming.camera_path import path_of_frames, with_time
from aa4d.filming.layers import draw
from tests.browser import Watched, launched, watched
from tests.export.scenes import riding
from tests.toy_run import silent

SCRIPT = "</title></script><script>window.stolen = 1</script>'\"><img src=x onerror=window.stolen=1>"
WINDOW = (480, 320)  # of the toy capture's shape, and with room for the controls
PAINTERS = ("gpu", "cpu")  # both by the processor here: one through WebGL, one by itself


@pytest.fixture(scope="module")
def clip(toy_run: Path) -> Clip:
    """Of ten frames, in which a square crosses the picture; the capture's folder has a hostile name."""
    loaded = riding(toy_run)
    assert loaded.capture_folder is not None
    hostile = replace(loaded, capture_folder=loaded.capture_folder.parent / SCRIPT.replace("/", "\u2044"))
    return Clip(hostile, path_of_frames(hostile, "all"), None)


@pytest.fixture(scope="module")
def page_file(clip: Clip, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("html")
    said = export(clip, "html", out, silent)
    assert said is not None
    assert re.match(r"0\.\d MB; places are rounded by at most [\d.]+ mm", said)
    return out / NAME


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with launched() as browser:
        yield browser


def block_of(page_file: Path) -> tuple[dict[str, Any], bytes]:
    """The header and the streams of a page's scene."""
    (text,) = re.findall(r'<script type="text/plain" id="scene">([^<]*)</script>', page_file.read_text("utf-8"))
    block = zlib.decompress(base64.b64decode(text))
    length = int.from_bytes(block[:4], "little")
    return json.loads(block[4 : 4 + length]), block[4 + length :]


def unpacked(header: dict[str, Any], streams: bytes) -> dict[str, np.ndarray]:
    """The values [T, N, D] of each attribute, as the player reads them."""
    n, keys, at, values = header["count"], len(header["t"]), 0, {}

    def numbers(count: int, width: int) -> np.ndarray:
        nonlocal at
        planes = np.frombuffer(streams, np.uint8, count * width, at).reshape(width, count).astype(np.int64)
        at += count * width
        number = sum(plane << 8 * byte for byte, plane in enumerate(planes))
        return np.where(number & 1, -(number >> 1) - 1, number >> 1)

    for name, a in header["attributes"].items():
        channels = []
        for _ in range(a["channels"]):
            first = numbers(n, a["first_bytes"])[None]
            changes = numbers((keys - 1) * n, a["change_bytes"]).reshape(keys - 1, n)
            channels.append(np.concatenate([first, changes]).cumsum(axis=0))
        values[name] = np.stack(channels, axis=-1) * a["step"]
    assert at == len(streams)
    return values


def test_every_number_at_a_key_is_within_half_a_step(clip: Clip, page_file: Path) -> None:
    header, streams = block_of(page_file)
    values = unpacked(header, streams)
    keys = [every_gaussian(clip.loaded, view.t, clip.eye_at(i)) for i, view in enumerate(clip.path.views)]
    ids = np.flatnonzero(np.any([g.opacities >= FAINTEST for g in keys], axis=0))
    assert header["count"] == len(ids)
    assert header["t"] == [view.t for view in clip.path.views]
    for index, g in enumerate(keys):
        opacity = np.where(g.opacities >= FAINTEST, g.opacities, 0)
        for name, expected in (
            ("position", g.means), ("log_scale", np.log(g.scales)), ("opacity", opacity[:, None]), ("color", g.colors),
        ):  # fmt: skip
            step = header["attributes"][name]["step"]
            assert np.abs(values[name][index] - expected[ids]).max() <= step / 2 + 1e-5, name
        rotation = values["rotation"][index] / np.linalg.norm(values["rotation"][index], axis=1, keepdims=True)
        assert np.abs((rotation * g.quaternions[ids]).sum(axis=1)).min() > 0.9999


@pytest.mark.parametrize("largest", [0, 100, 127, 128, 40_000, 2**29])
def test_levels_of_any_size_are_read_back(largest: int) -> None:
    random = np.random.default_rng(largest)
    levels = random.integers(-largest, largest, (3, 5, 2), endpoint=True).astype(np.int32)
    levels[:, :2] = [[-largest, largest], [largest, -largest]]
    levels[1] = -levels[0]
    streams, widths = packed_keys(levels)
    header = {"count": 5, "t": [0, 0.5, 1], "attributes": {"a": {"channels": 2, "step": 1, **widths}}}
    np.testing.assert_array_equal(unpacked(header, streams)["a"], levels)


def test_what_is_out_of_range_is_held_at_its_end() -> None:
    assert rounded(np.array([[-20.7, 0.044, 99]], np.float32), Attribute(3, 0.03, 511)).tolist() == [[-511, 1, 511]]


def test_a_page_that_is_there_is_kept_and_one_of_a_still_moment_has_one_key(clip: Clip, page_file: Path) -> None:
    was = page_file.stat().st_mtime_ns
    assert export(clip, "html", page_file.parent, silent) is not None
    assert page_file.stat().st_mtime_ns == was
    with pytest.raises(InputError, match="html: the times of the views must rise"):
        export(replace(clip, path=with_time(clip.path, 0.5)), "html", page_file.parent / "frozen", silent)


def test_names_of_a_run_are_never_markup(page_file: Path) -> None:
    header, streams = block_of(page_file)
    for text in (page_file.read_text("utf-8"), page_of(header | {"title": SCRIPT}, streams)):
        assert "window.stolen" in text  # as the title, escaped
        assert "<script>window.stolen" not in text
        assert "<img" not in text
        assert text.count("<script") == text.count("</script>") == 5
        assert text.count("</title>") == 1


def test_the_players_parts_cannot_end_the_script_that_they_are_in() -> None:
    for path in PLAYER.iterdir():
        if path.suffix != ".jinja":
            assert "</" not in path.read_text("utf-8"), path.name


@pytest.fixture(scope="module", params=PAINTERS)
def seen(page_file: Path, browser: Browser, request: pytest.FixtureRequest) -> Iterator[Watched]:
    """The page as it stands after opening."""
    with watched(browser, *WINDOW) as seen:
        seen.page.goto(f"{page_file.as_uri()}#play=off&painter={request.param}")
        seen.page.wait_for_selector("body.ready", timeout=60_000)
        yield seen


def told(page: Page, script: str, value: object = None) -> Any:
    """What a function of the player and a value returns, once the picture is that of now."""
    body = f"async (value) => {{ const player = await window.player; const r = ({script})(player, value);"
    return page.evaluate(f"{body} await player.settled(); return r ?? null; }}", value)


def shot(page: Page) -> np.ndarray:
    """The picture [H, W, 3] without the controls above it."""
    page.evaluate("for (const e of document.querySelectorAll('#bar, #title')) e.style.opacity = 0")
    return np.array(Image.open(io.BytesIO(page.screenshot(animations="disabled"))).convert("RGB"))


def decibels(a: np.ndarray, b: np.ndarray) -> float:
    error = ((a.astype(float) - b) ** 2).mean() / 255**2
    return float(-10 * np.log10(max(error, 1e-12)))


def test_the_page_draws_what_the_model_does(seen: Watched, clip: Clip) -> None:
    camera = clip.path.camera
    seen.page.set_viewport_size({"width": camera.width, "height": camera.height})
    for index in (0, 4, 9):
        view = clip.path.views[index]
        told(seen.page, "(player, s) => player.seek(s)", clip.seconds(index))
        expected = draw(clip.loaded, view, clip.path.camera, ["color"]).color
        assert decibels(shot(seen.page), expected) > 40
    seen.page.set_viewport_size({"width": WINDOW[0], "height": WINDOW[1]})
    assert told(seen.page, "(player) => player.painter.name") in ("WebGL 2", "the processor")


def test_between_two_keys_the_page_shows_what_lies_between(seen: Watched, clip: Clip) -> None:
    told(seen.page, "(player, s) => player.seek(s)", clip.seconds(4))
    before = shot(seen.page)
    told(seen.page, "(player, s) => player.seek(s)", (clip.seconds(4) + clip.seconds(5)) / 2)
    assert decibels(shot(seen.page), before) < 45


def test_it_is_scrubbed_orbited_panned_and_zoomed(seen: Watched, clip: Clip) -> None:
    page = seen.page
    told(page, "(player) => { player.fly(); player.seek(0); }")
    page.evaluate("async () => { const p = await player; while (p.returning) await p.settled(); }")
    start, pictures = shot(page), []
    page.locator("#time").fill(str(clip.seconds(6)))
    pictures.append((told(page, "(player) => player.seconds"), shot(page)))
    assert pictures[-1][0] == pytest.approx(clip.seconds(6), abs=2e-3)
    before = told(page, "(player) => player.pose.center")
    width, height = WINDOW
    for button, keys in (("left", None), ("right", None), ("left", "Shift")):
        if keys:
            page.keyboard.down(keys)
        page.mouse.move(width / 2, height / 3)
        page.mouse.down(button=button)
        page.mouse.move(width / 2 + 20, height / 3 + 6, steps=3)
        page.mouse.up(button=button)
        if keys:
            page.keyboard.up(keys)
        assert not told(page, "(player) => player.flying")
        after = told(page, "(player) => player.pose.center")
        assert np.abs(np.subtract(after, before)).max() > 1e-3
        before = after
        pictures.append((0, shot(page)))
    away = told(page, "(player) => Math.hypot(...plus(player.target, player.pose.center, -1))")
    page.mouse.wheel(0, -200)
    told(page, "() => 0")
    closer = told(page, "(player) => Math.hypot(...plus(player.target, player.pose.center, -1))")
    assert 0.5 * away < closer < 0.9 * away
    pictures.append((0, shot(page)))
    for (_, a), (_, b) in zip([(0, start), *pictures], pictures, strict=False):
        assert decibels(a, b) < 40  # each is another picture
    page.keyboard.press("c")
    page.keyboard.press("Home")
    page.evaluate("async () => { const p = await player; while (p.returning) await p.settled(); }")
    told(page, "() => 0")
    assert decibels(shot(page), start) > 45


def test_it_plays_at_the_speed_that_is_chosen_and_steps(seen: Watched, clip: Clip) -> None:
    page = seen.page
    told(page, "(player) => player.seek(0)")
    page.keyboard.press("]")
    assert page.locator("#speed").inner_text() == "2×"
    page.keyboard.press("[")
    page.keyboard.press(" ")
    assert page.evaluate("async () => (await player).playing")
    page.wait_for_function("() => window.player.then((p) => p.seconds > 0)")
    page.locator("#play").click()
    assert not told(page, "(player) => player.playing")
    told(page, "(player, s) => player.seek(s)", clip.seconds(3) + 0.01)
    for key, index in (("ArrowRight", 4), ("ArrowRight", 5), ("ArrowLeft", 4), ("End", 9)):
        page.keyboard.press(key)
        assert told(page, "(player) => player.seconds") == pytest.approx(clip.seconds(index))
    page.keyboard.press("h")
    assert page.locator("#about").is_visible()
    assert clip.loaded.method in page.locator("#facts").inner_text()
    page.keyboard.press("Escape")


def test_the_bar_hides_after_a_click_and_stays_for_a_keyboard(seen: Watched) -> None:
    page = seen.page
    page.evaluate(
        "for (const e of document.querySelectorAll('#bar, #title')) e.style.opacity = ''"
    )  # as `shot` left it
    page.locator("#play").click()
    page.mouse.move(WINDOW[0] / 2, 20)
    hidden = "() => getComputedStyle(document.getElementById('bar')).opacity === '0'"
    page.wait_for_function(hidden)
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    page.wait_for_function("() => document.activeElement.closest('#bar')")
    page.wait_for_function("() => document.body.classList.contains('idle')")
    assert not page.evaluate(hidden)
    page.locator("#play").click()
    page.evaluate("document.activeElement.blur()")


def test_the_bar_hides_after_a_tap(page_file: Path, browser: Browser) -> None:
    context = browser.new_context(viewport={"width": 400, "height": 700}, has_touch=True, is_mobile=True)
    page = context.new_page()
    page.goto(f"{page_file.as_uri()}#play=off")
    page.wait_for_selector("body.ready", timeout=60_000)
    page.locator("#help").tap()
    page.locator("#about button").tap()
    page.locator("#about").wait_for(state="hidden")
    page.wait_for_function("() => document.activeElement === document.body")
    page.locator("#play").tap()
    page.wait_for_function("() => document.body.classList.contains('playing')")
    page.wait_for_function("() => getComputedStyle(document.getElementById('bar')).opacity === '0'")
    assert page.evaluate("document.activeElement === document.body")
    assert page.evaluate("getComputedStyle(document.getElementById('bar')).opacity") == "0"
    context.close()


def test_whoever_has_the_focus_of_a_keyboard_shows_it(seen: Watched) -> None:
    page, rings = seen.page, {}
    page.locator("#picture").focus()
    for _ in range(8):
        page.keyboard.press("Tab")
        focused = page.evaluate(
            "() => { const e = document.activeElement, s = getComputedStyle(e); return [e.id, s.outlineStyle]; }"
        )
        rings[focused[0]] = focused[1]
    assert {"picture", "play", "time", "speed", "fly", "help"} <= rings.keys()
    assert all(style != "none" for name, style in rings.items() if name)
    page.evaluate("document.activeElement.blur()")


def test_time_stands_while_nobody_sees_the_page(seen: Watched) -> None:
    told(seen.page, "(player) => player.seek(0)")
    passed = seen.page.evaluate("""async () => {
        const player = await window.player;
        player.play();
        await new Promise(requestAnimationFrame);
        player.last -= 1e6; // what a browser calls again only now
        document.dispatchEvent(new Event("visibilitychange"));
        await new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve)));
        const { seconds } = player;
        player.play(false);
        return seconds;
    }""")
    assert 0 <= passed < 0.9 * told(seen.page, "(player) => player.length")


def test_slow_pictures_get_coarser_however_slow_they_are(seen: Watched) -> None:
    scale = seen.page.evaluate("""async () => {
        const player = await window.player, { draw } = player.painter;
        const late = (ms) => { const end = performance.now() + ms; while (performance.now() < end); };
        player.painter.draw = function (view) { late(250); return draw.call(this, view); };
        const first = player.pictures;
        player.scale = 1;
        player.play();
        while (player.pictures < first + 6) await new Promise(requestAnimationFrame);
        delete player.painter.draw;
        player.play(false);
        return player.scale;
    }""")
    assert scale < 0.9


def test_it_is_quiet_and_asks_for_nothing(seen: Watched) -> None:
    """Last of those that share the page: nothing that they did was an error, or went to a network, or ran a name."""
    assert [e for e in seen.errors if "GPU stall due to ReadPixels" not in e] == []
    assert seen.requests == []
    assert seen.page.evaluate("() => window.stolen === undefined")
    assert "<img" in seen.page.title()


def test_a_browser_without_webgl_draws_it_all_the_same(page_file: Path, browser: Browser, clip: Clip) -> None:
    with watched(browser, clip.path.camera.width, clip.path.camera.height) as seen:
        seen.page.add_init_script("""
            const get = HTMLCanvasElement.prototype.getContext;
            HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
                return kind === "webgl2" ? null : get.call(this, kind, ...rest);
            };""")
        seen.page.goto(f"{page_file.as_uri()}#play=off&painter=gpu")
        seen.page.wait_for_selector("body.ready", timeout=60_000)
        assert told(seen.page, "(player) => player.painter.name") == "the processor"
        expected = draw(clip.loaded, clip.path.views[0], clip.path.camera, ["color"]).color
        assert decibels(shot(seen.page), expected) > 40


def test_without_scripts_the_page_says_so_and_nothing_else(page_file: Path, browser: Browser) -> None:
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(page_file.as_uri())
    words = page.locator("body").inner_text()
    assert "which is switched off here" in words
    assert "Opening" not in words
    context.close()


@pytest.mark.parametrize(("init", "words"), [
    ("delete window.DecompressionStream", "This browser is too old to open the scene"),
    ("window.atob = () => 'nonsense'", "the file is damaged"),
])  # fmt: skip
def test_what_cannot_be_opened_says_so(page_file: Path, browser: Browser, init: str, words: str) -> None:
    with watched(browser, 390, 600) as seen:
        seen.page.add_init_script(init)
        seen.page.goto(page_file.as_uri())
        seen.page.locator("#message").wait_for(timeout=30_000)
        assert words in seen.page.locator("#message").inner_text()
