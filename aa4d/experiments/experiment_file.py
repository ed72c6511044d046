"""Experiment files: scenes x variants x seeds as TOML, checked and resolved to the settings of every run.

docs/experiments.md describes their keys.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

from aa4d.errors import InputError
from aa4d.experiments.axis import Axis, Changes, Knob, Position, axis_of
from aa4d.experiments.derived_scene import merged
from aa4d.graph.task import Resources
from aa4d.methods import DEFAULT, presets_of
from aa4d.methods.settings import MotionSettings, RunSettings, with_iterations
from aa4d.settings.allowed import Count, NameIn, Seed
from aa4d.settings.checking import Place, changed, describe, nearest, one_of, repeated
from aa4d.settings.given import Given
from aa4d.settings.toml import read_toml

MODULES = ("dlgd", "dacw")
MOTION = {"none": None, "tracks": MotionSettings()}
SCENE_ENDING = ".toml"
OF_SCENES = ("time", "camera", "flight", "street")  # sections that every scene file has, and no experiment
SCENES = "scenes: missing; name scene files, which are rendered, or capture folders, as seen from this file"


@dataclass(frozen=True, kw_only=True)
class Head:
    """The keys at the top of a file."""

    title: str = ""
    scenes: tuple[str, ...] = ()
    seeds: tuple[Seed, ...] = (0,)
    preset: Annotated[str, NameIn("aa4d.methods", "preset_names")] = "quick"
    iterations: tuple[Count, Count] | None = None  # coarse and fine, instead of the preset's
    resources: Resources = field(default_factory=Resources)  # of a training
    BESIDE: ClassVar = ("axis", "scene", "settings", "variants")


@dataclass(frozen=True)
class VariantKeys:
    """The keys of a variant."""

    method: Annotated[str, NameIn("aa4d.methods", "METHODS")] = DEFAULT
    motion: Annotated[str, NameIn("aa4d.experiments.experiment_file", "MOTION")] = "none"
    aggregation: str | None = None  # checked with the settings that it is one of
    BESIDE: ClassVar = ("modules", "settings")


@dataclass(frozen=True)
class Source:
    """Something to train on."""

    base: str  # name of the file or the folder
    path: Path  # of a scene file, or of a capture folder
    rendered: str  # name of the scene with these changes
    changes: Changes = field(default_factory=dict, hash=False)  # of keys of the scene file
    keep_every: int = 1  # of its training frames every n-th
    at: float | None = None  # of the experiment's axis

    @property
    def name(self) -> str:
        return self.base if self.at is None else f"{self.base} {self.at:g}"

    @property
    def is_scene(self) -> bool:
        return self.path.suffix == SCENE_ENDING


@dataclass(frozen=True)
class ExperimentFile:
    path: Path
    head: Head
    sources: tuple[Source, ...]
    variants: Mapping[str, RunSettings]  # by their names; the seed is still the first one
    knob: Knob | None = None  # of the axis


def read_experiment(path: Path) -> ExperimentFile:
    """
    Raises:
        InputError: the file cannot be read, a key or a name is unknown, a value is not allowed, a scene is not there or
            named twice, a capture would have to be rendered otherwise, or there is no variant.
    """
    table = read_toml(path, "experiment file")

    def place(where: str) -> str:
        return f"{path}: {where}"

    of_scenes = [key for key in OF_SCENES if key in table]
    if of_scenes and "variants" not in table and "scenes" not in table:
        raise InputError(
            f"{path}: looks like a scene file (it has [{'], ['.join(of_scenes)}] and no variants); name an experiment "
            "file, whose `scenes` may name this one"
        )
    variants, settings = table.pop("variants", {}), table.pop("settings", {})
    scene, axis = table.pop("scene", {}), table.pop("axis", None)
    for name, section in (("variants", variants), ("settings", settings), ("scene", scene)):
        if not isinstance(section, Mapping):
            raise InputError(f"{path}: {name}: is a section; it cannot be {describe(section)}")
    if not variants:
        raise InputError(f"{path}: has no variant; add a section [variants.NAME], empty for the preset as it is")
    for name in variants:
        if not name.strip() or not name.isprintable():
            raise InputError(f"{path}: variants: {name!r} is no name for tables and figures; write words on one line")
    head = changed(Head(), table, place)
    if not head.title or not head.scenes:
        raise InputError(f"{path}: {SCENES if head.title else 'title: missing; say what is compared'}")
    if (twice := repeated(head.seeds)) is not None:
        raise InputError(f"{path}: seeds: {twice}")
    resolved = {name: _settings(head, name, variants[name], settings, place) for name in variants}
    turned = None if axis is None else axis_of(axis, lambda where: place(f"axis.{where}"))
    sources = tuple(_at_positions(path, _sources(path, head.scenes), scene, turned))
    return ExperimentFile(path, head, sources, resolved, None if turned is None else turned.knob)


def _settings(head: Head, name: str, variant: Any, common: Mapping[str, Any], place: Place) -> RunSettings:
    """The settings of a variant: preset, iterations, the file's settings, the variant's; the later ones win."""

    def here(where: str) -> str:
        return place(f"variants.{name}.{where}" if where else f"variants.{name}")

    if not isinstance(variant, Mapping):
        raise InputError(f"{here('')}: is a section; it cannot be {describe(variant)}")
    given = dict(variant)
    modules, own = given.pop("modules", None), given.pop("settings", {})
    keys = changed(VariantKeys(), given, here)
    presets = presets_of(keys.method)
    if head.preset not in presets:
        raise InputError(f"{here('method')}: {keys.method} has no preset {head.preset}; it has {', '.join(presets)}")
    base = presets[head.preset]
    try:
        base = replace(base, motion=MOTION[keys.motion], seed=head.seeds[0])
    except ValueError as error:
        raise InputError(f"{here('motion')}: {error}") from None
    if head.iterations is not None:
        base = with_iterations(base, *head.iterations)
    model: dict[str, Any] = {} if keys.aggregation is None else {"aggregation": keys.aggregation}
    if modules is not None:
        model |= _switches(modules, here("modules"))
    for key in model:
        if not hasattr(getattr(base, "model", None), key):
            name_here = here("modules" if key in MODULES else key)
            raise InputError(f"{name_here}: {keys.method} has none; leave it out")
    layers = [
        (common, lambda where: place(f"settings.{where}")),
        ({"model": model} if model else {}, lambda where: here(where.removeprefix("model."))),
        (own, lambda where: here(f"settings.{where}")),
    ]
    for table, where in layers:
        if isinstance(table, Mapping) and "seed" in table:
            raise InputError(f"{where('seed')}: every run has one of `seeds`, at the top of the file; leave this out")
        if isinstance(table, Mapping) and "preset" in table:
            # Its values would be those of one preset and its name that of another.
            raise InputError(f"{where('preset')}: `preset`, at the top of the file, is that of all; leave this out")
    return Given(tuple(layers)).applied(base, withheld=("seed", "preset"))


def _switches(modules: Any, where: str) -> dict[str, bool]:
    if not isinstance(modules, list):
        raise InputError(f"{where}: must be a list of {', '.join(MODULES)}; [] for none")
    for module in modules:
        if module not in MODULES:
            raise InputError(f"{where}: {describe(module)} must be {one_of(MODULES, module)}")
    if (twice := repeated(modules)) is not None:
        raise InputError(f"{where}: {twice}")
    return {module: module in modules for module in MODULES}


def _sources(path: Path, scenes: tuple[str, ...]) -> tuple[Source, ...]:
    found: list[Source] = []
    for index, text in enumerate(scenes):
        there = path.parent / text
        name = there.stem if there.suffix == SCENE_ENDING else there.resolve().name
        source = Source(name, there, name)
        where = f"{path}: scenes[{index}]"
        if source.is_scene and not there.is_file():
            near = nearest(there.name, [p.name for p in sorted(there.parent.glob(f"*{SCENE_ENDING}"))])
            raise InputError(f"{where}: {there}: no such scene file" + (f"; did you mean {near}?" if near else ""))
        if not source.is_scene and not (there / "capture.json").is_file():
            raise InputError(f"{where}: {there}: neither a scene file (*.toml) nor a capture folder")
        if name in [other.name for other in found]:
            raise InputError(f"{where}: two scenes are called {name!r}; rename a file or a folder")
        found.append(source)
    return tuple(found)


def _at_positions(path: Path, sources: tuple[Source, ...], scene: Changes, axis: Axis | None) -> Iterator[Source]:
    """Each source at each position of the axis, with what the file changes in all scenes."""
    for source in sources:
        for position in (Position(0.0, {}),) if axis is None else axis.positions:
            changes = merged(scene, position.changes)
            if changes and not source.is_scene:
                raise InputError(f"{path}: scenes: {source.path}: is a capture, in which no key of a scene can change")
            yield replace(
                source,
                rendered=f"{source.base}-{position.at:g}" if position.changes else source.base,
                changes=changes,
                keep_every=position.keep_every,
                at=None if axis is None else position.at,
            )
