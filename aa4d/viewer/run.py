"""`aa4d view` from its beginning to Ctrl-C."""

from __future__ import annotations

import contextlib
import io
import time
from collections.abc import Callable
from ipaddress import ip_address
from pathlib import Path

from aa4d.errors import InputError
from aa4d.interrupts import StopRequest, stop_requests
from aa4d.viewer.drawing import Drawing
from aa4d.viewer.following import Followed
from aa4d.viewer.page import Page
from aa4d.viewer.server import check_free, serve
from aa4d.viewer.shown import Shown

SECONDS_BETWEEN_LOOKS = 1.0  # at the files of a run
SECONDS_BETWEEN_STOPS = 0.1  # at whether Ctrl-C was pressed


def view(runs: list[Path], capture: Path | None, host: str, port: int, say: Callable[[str], None]) -> None:
    """Serve a page that shows the runs, until a signal asks to stop.

    Args:
        capture: where their capture lies, or None to follow their own word.
        say: is told where the page is, and in a sentence what goes wrong later.

    Raises:
        InputError: a run has no model or a damaged one, two are of different captures, or nothing can listen there.
    """
    followed = [Followed(run, capture) for run in runs]
    check_free(host, port)  # before models are loaded, which takes longer
    with stop_requests() as stop_requested:
        shown = tuple(run.load() for run in followed)
        check_one_capture(shown)
        for its in shown:
            if its.footage is None:
                say(f"{its.loaded.capture_folder}: the capture is not there; {its.name} is shown without its frames")
        server = serve(host, port)
        drawing = Drawing(shown)
        try:
            page = Page(server, drawing)
            drawing.start()
            say(f"viewer: http://{_address(host)}:{server.get_port()} ({_who_may(host)}); Ctrl-C ends it")
            _follow(followed, page, stop_requested, say)
        finally:
            drawing.stop()
            with contextlib.redirect_stdout(io.StringIO()):  # viser's farewell
                server.stop()


def check_one_capture(shown: tuple[Shown, ...]) -> None:
    """Raises InputError where two are known to be of different captures: one camera does not fit both."""
    known = [(its, its.loaded.identity.made_from.get("capture")) for its in shown]
    first = next(((its, digest) for its, digest in known if digest is not None), None)
    for its, digest in known:
        if first is not None and digest is not None and digest != first[1]:
            raise InputError(
                f"{its.loaded.path}: is of another capture than {first[0].loaded.path}; view runs of one capture"
            )


def _follow(followed: list[Followed], page: Page, stop_requested: StopRequest, say: Callable[[str], None]) -> None:
    looked = time.monotonic()
    while not stop_requested():
        time.sleep(SECONDS_BETWEEN_STOPS)
        if time.monotonic() - looked < SECONDS_BETWEEN_LOOKS:
            continue
        for index, run in enumerate(followed):
            try:
                if (shown := run.news()) is not None:
                    page.replace(index, shown)
                    say(f"{shown.name}: {shown.state}")
            except InputError as error:
                trouble = f"{error}; the page keeps what it showed"
                page.warn(index, trouble)
                say(trouble)
        looked = time.monotonic()


def _address(host: str) -> str:
    return "127.0.0.1" if host == "0.0.0.0" else f"[{host}]" if ":" in host else host


def _who_may(host: str) -> str:
    try:
        is_local = ip_address(host).is_loopback
    except ValueError:
        is_local = host == "localhost"
    if is_local:
        return "this machine alone; --host 0.0.0.0 lets others in"
    return "whoever reaches this machine may look and change what is shown"
