"""A real browser for tests of pages: Chromium without a window, without a network, WebGL drawn by the CPU.

Playwright drives it and brings no browser of its own. Chromium is looked for under AA4D_BROWSER, a path or a name, and
else under its usual names on PATH; where there is none, the test is skipped.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Browser, Page, Request, Route, sync_playwright

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = (
    "--no-sandbox",  # tests may run as root, in a container
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--force-color-profile=srgb",
)
LOCAL = ("file", "data", "blob", "about")  # schemes behind which there is no network


def find_browser() -> str | None:
    wanted = os.environ.get("AA4D_BROWSER")
    names = (wanted,) if wanted else NAMES
    return next((found for name in names if (found := shutil.which(name))), None)


@contextmanager
def launched(*flags: str) -> Iterator[Browser]:
    """Chromium, or a skipped test where there is none; `flags` are added to `FLAGS`."""
    path = find_browser()
    if path is None:
        pytest.skip(f"no Chromium: AA4D_BROWSER names none, nor is one of {', '.join(NAMES)} on PATH")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=[*FLAGS, *flags])
        try:
            yield browser
        finally:
            browser.close()


@dataclass
class Watched:
    """A page and what it has said and asked for since it was opened."""

    page: Page
    errors: list[str] = field(default_factory=list)  # exceptions, and errors and warnings on the console
    requests: list[str] = field(default_factory=list)  # addresses beyond files and what the page itself holds


@contextmanager
def watched(
    browser: Browser, width: int, height: int, *, allowed: str | None = None, scale: float = 1
) -> Iterator[Watched]:
    """A new page of this size in CSS pixels, whose requests to a network are noted and refused.

    Args:
        allowed: host and port that it may talk to ("127.0.0.1:8080"), or None.
        scale: device pixels for each CSS pixel.
    """
    context = browser.new_context(viewport={"width": width, "height": height}, device_scale_factor=scale)
    page = context.new_page()
    seen = Watched(page)

    def is_near(request: Request) -> bool:
        address = urlsplit(request.url)
        return address.scheme in LOCAL or (allowed is not None and address.netloc == allowed)

    def decide(route: Route) -> None:
        if is_near(route.request):
            route.continue_()
        else:
            seen.requests.append(route.request.url)
            route.abort()

    context.route("**/*", decide)
    page.on("pageerror", lambda error: seen.errors.append(str(error)))
    page.on("console", lambda m: seen.errors.append(m.text) if m.type in ("error", "warning") else None)
    try:
        yield seen
    finally:
        context.close()
