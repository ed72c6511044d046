"""How long a graph will take where nothing of its kind has been measured yet."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from aa4d.graph.costs import Costs
from aa4d.graph.store import Store
from aa4d.graph.task import Task

# Seconds a unit on two idle cores, by kind and size. A task of kind cost has its own estimate, in seconds.
RATES = {
    ("cost", "quick"): 1.0,
    ("cost", "full"): 1.0,
    ("render", "quick"): 50.0,
    ("render", "full"): 95.0,
    ("train", "quick"): 0.014,
    ("train", "full"): 0.045,
    ("evaluate", "quick"): 4.0,
    ("evaluate", "full"): 11.0,
}
# Of a training, against adaanchor4d (docs/measured/methods.json).
DEARER = {"d3dgs": 4.2, "speede": 4.2, "fourdgs": 1.7, "modec": 1.6, "sdgs": 1.6, "morel": 0.8, "sfgs": 0.7}


def costs(tasks: Sequence[Task], size: str, stores: Iterable[Store]) -> Costs:
    """Costs that were measured, in the stores, and a rough estimate of all else."""
    known = Costs(stores)
    for task in [task for task in tasks if known.seconds(task) is None]:
        dearer = DEARER.get(task.alike.partition(" ")[0], 1.0)
        known.add(task, RATES[task.kind, size] * task.units * dearer)
    return known
