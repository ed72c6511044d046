"""Words for people: names of theirs in figures."""

import warnings

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from aa4d.words import in_figure


def test_names_that_mean_something_to_matplotlib_stand_in_a_legend_as_they_are() -> None:
    figure = Figure()
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for name in ("_calm", "__", "cost $5 to $9", "plain_name"):
        axes.plot([0, 1], label=in_figure(name))
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a letter that the font has not
        legend = axes.legend()
        figure.canvas.draw()
    texts = [text.get_text() for text in legend.get_texts()]
    assert [text.lstrip("\u200b").replace(r"\$", "$") for text in texts] == [
        "_calm",
        "__",
        "cost $5 to $9",
        "plain_name",
    ]
    assert in_figure("plain_name") == "plain_name"
