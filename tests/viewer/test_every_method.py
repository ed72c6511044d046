"""The viewer's panel for a run of each method: layers that a method lacks are not in the menu, the others are drawn."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("viser")

from aa4d.methods import METHODS
from aa4d.viewer.cameras import Eye
from aa4d.viewer.drawing import Drawing
from aa4d.viewer.following import Followed
from aa4d.viewer.page import Page
from aa4d.viewer.pictures import LAYER_NAMES, Painter, Wanted
from aa4d.viewer.server import serve
from tests.methods.test_every_method import run  # noqa: F401, the fixture: a run of each method

WIDTH, HEIGHT = 36, 24
WITHOUT_PLANES = {"activity"}
WITHOUT_GROUPS = {"movers"}


@pytest.fixture
def page(run: Path) -> Iterator[Page]:  # noqa: F811
    server = serve("127.0.0.1", 0)
    drawing = Drawing((Followed(run, None).load(),))
    yield Page(server, drawing)
    server.stop()


def test_the_menu_has_the_layers_of_the_method(page: Page, run: Path) -> None:  # noqa: F811
    assert run.name in METHODS
    [shown] = page.drawing.shown
    options = page._layer.options
    assert options == tuple(name for name in LAYER_NAMES if name not in shown.lacking)
    assert set(LAYER_NAMES) - set(options) <= WITHOUT_PLANES | WITHOUT_GROUPS
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
