"""The paper's comparison: every method, and AdaAnchor4D with tracked movers beside it, over as many iterations."""

from __future__ import annotations

from aa4d import methods
from aa4d.errors import InputError
from aa4d.experiments.variants import Experiment, Variant
from aa4d.methods import DEFAULT, METHODS, presets_of
from aa4d.methods.adaanchor4d.settings import PRESETS, AdaAnchor4DSettings
from aa4d.methods.settings import MotionSettings, with_iterations

NAME = "compare"
TRACKED = f"{DEFAULT}+tracks"  # what `aa4d train` does where nothing is said: anchors ride on tracks


def entries() -> tuple[str, ...]:
    """What can be compared: the rivals, then the default method and its own with tracks, as in the paper's table."""
    return (*(name for name in METHODS if name != DEFAULT), DEFAULT, TRACKED)


def title_of(entry: str) -> str:
    """As a table and a picture call an entry."""
    if entry == TRACKED:
        return f"{title_of(DEFAULT)} + tracks"
    return methods.title_of(entry)


def comparison_of(names: tuple[str, ...]) -> Experiment:
    """Of the entries in `names`, in the order of `entries`."""
    tracked = {"motion": MotionSettings()}
    variants = [
        Variant(name, training=tracked) if name == TRACKED else Variant(name, method=name)
        for name in entries()
        if name in names
    ]
    return Experiment(NAME, "Comparison of methods", tuple(variants))


def base_settings(experiment: Experiment, preset: str, iterations: tuple[int, int] | None) -> AdaAnchor4DSettings:
    """What every method's settings follow: the preset of that name, and its number of iterations.

    Raises:
        InputError: a method has no preset of that name.
    """
    for method in (variant.method for variant in experiment.variants):
        if preset not in presets_of(method):
            raise InputError(
                f"--preset {preset}: {method} has none of that name; choose one of {', '.join(presets_of(method))}"
            )
    base = PRESETS[preset]
    return base if iterations is None else with_iterations(base, *iterations)
