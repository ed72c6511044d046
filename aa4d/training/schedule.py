"""The stages of a run: the method's, and those that finding movers adds."""

from __future__ import annotations

from dataclasses import dataclass, replace

from aa4d.methods import method_of
from aa4d.methods.contract import Stage
from aa4d.methods.settings import RunSettings

CLEAN = "clean"  # the last canonical stage once more, without what seems to move


@dataclass(frozen=True)
class Schedule:
    stages: tuple[Stage, ...]

    def __getitem__(self, name: str) -> Stage:
        return next(stage for stage in self.stages if stage.name == name)

    def after(self, name: str) -> Stage | None:
        index = self.stages.index(self[name])
        return self.stages[index + 1] if index + 1 < len(self.stages) else None

    def iterations_before(self, name: str) -> int:
        return sum(stage.iterations for stage in self.stages[: self.stages.index(self[name])])

    @property
    def total(self) -> int:
        return sum(stage.iterations for stage in self.stages)

    @property
    def first_moving(self) -> Stage:
        """The first stage in which something moves."""
        return next(stage for stage in self.stages if not stage.canonical)


def schedule_of(settings: RunSettings) -> Schedule:
    stages = method_of(settings.method).stages(settings)
    motion = settings.motion
    if motion is None or not motion.needs_static or not motion.clean_iterations:
        return Schedule(stages)
    canonical = [stage for stage in stages if stage.canonical]
    draws = 1 + max(stage.draws for stage in stages)
    clean = replace(canonical[-1], name=CLEAN, iterations=motion.clean_iterations, draws=draws, changes_units=False)
    return Schedule((*canonical, clean, *stages[len(canonical) :]))
