"""The viewer's panel for a run of each method: layers that a method lacks are not in the menu, the others are drawn."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("viser")

from aa4d.capture.reader import read_capture
from aa4d.methods import METHODS, method_of
from aa4d.methods.settings import with_iterations
from aa4d.training.trainer import train
from aa4d.viewer.cameras import Eye
from aa4d.viewer.drawing import Drawing
from aa4d.viewer.following import Followed
from aa4d.viewer.page import Page
from aa4d.viewer.pictures import LAYER_NAMES, Painter, Wanted
from aa4d.viewer.server import serve
from tests.toy_capture import write_toy_capture
from tests.toy_run import silent

WIDTH, HEIGHT = 36, 24
WITHOUT_WEIGHTS = {"activity", *(name for name in LAYER_NAMES if name.startswith("weight-"))}
WITHOUT_GROUPS = {"movers"}


@pytest.fixture(params=METHODS)
def run(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A few iterations of each method."""
    capture = write_toy_capture(tmp_path / "capture")
    settings = with_iterations(method_of(request.param).presets["quick"], 3, 3)
    train(read_capture(capture), tmp_path / request.param, settings, silent)
    return tmp_path / request.param


@pytest.fixture
def page(run: Path) -> Iterator[Page]:
    server = serve("127.0.0.1", 0)
    drawing = Drawing((Followed(run, None).load(),))
    yield Page(server, drawing)
    server.stop()


def test_the_menu_has_the_layers_of_the_method(page: Page, run: Path) -> None:
    [shown] = page.drawing.shown
    options = page._layer.options
    assert options == tuple(name for name in LAYER_NAMES if name not in shown.lacking)
    assert set(LAYER_NAMES) - set(options) <= WITHOUT_WEIGHTS | WITHOUT_GROUPS
    assert {"color", "depth", "alpha", "motion", "speed", "error", "frame"} <= set(options)
    assert shown.loaded.method == run.name
    assert "units" in page._title.content
    frame = shown.loaded.frames[3]
    for layer in options:
        page._layer.value = layer
        picture = Painter().picture((shown,), wanted(page, frame.viewmat, frame.time_s), WIDTH, HEIGHT)
        assert picture.notes == ()
        assert picture.pixels.shape == (HEIGHT, WIDTH, 3)
        assert picture.pixels.std() > 0


def wanted(page: Page, viewmat: np.ndarray, second: float) -> Wanted:
    """What the panel asks for."""
    return Wanted(Eye(viewmat, 0.7), WIDTH / HEIGHT, second, page._layer.value, ribbons=True)
