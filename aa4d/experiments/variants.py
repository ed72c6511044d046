"""What is compared with what: the paper's ablations and our sweeps, each a family of variants of one training."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from aa4d.methods import presets_of
from aa4d.methods.adaanchor4d.settings import AdaAnchor4DSettings
from aa4d.methods.settings import MotionSettings, RunSettings, with_iterations


@dataclass(frozen=True)
class Variant:
    """One row of a table: settings that differ from the preset's and the model's defaults."""

    label: str
    model: dict[str, Any] = field(default_factory=dict)  # of ModelConfig
    warp: dict[str, Any] = field(default_factory=dict)  # of WarpSettings
    training: dict[str, Any] = field(default_factory=dict)  # of the whole settings
    method: str = AdaAnchor4DSettings.method  # of another one the preset of the same name, over as many iterations

    def settings(self, base: AdaAnchor4DSettings) -> RunSettings:
        if self.method != base.method:
            other = replace(presets_of(self.method)[base.preset], checkpoint_every=base.checkpoint_every)
            return with_iterations(other, base.coarse_iterations, base.fine_iterations)
        model, warp = replace(base.model, **self.model), replace(base.warp, **self.warp)
        return replace(base, model=model, warp=warp, **self.training)


@dataclass(frozen=True)
class Experiment:
    """Differences in the tables are to the first variant."""

    name: str
    title: str
    variants: tuple[Variant, ...]


def _modules(label: str, aggregation: str, *, dlgd: bool, dacw: bool) -> Variant:
    return Variant(label, {"aggregation": aggregation, "dlgd": dlgd, "dacw": dacw})


ABLATIONS = {
    "modules": Experiment(
        "modules",
        "What each module adds (paper, table of ACFA, DLGD and DACW)",
        (
            _modules("product", "product", dlgd=False, dacw=False),
            _modules("ACFA", "acfa", dlgd=False, dacw=False),
            _modules("ACFA + DLGD", "acfa", dlgd=True, dacw=False),
            _modules("ACFA + DACW", "acfa", dlgd=False, dacw=True),
            _modules("ACFA + DLGD + DACW", "acfa", dlgd=True, dacw=True),
        ),
    ),
    "motion": Experiment(
        "motion",
        "What riding on tracks adds (beyond the paper)",
        (
            Variant("paper"),
            Variant("tracks", training={"motion": MotionSettings()}),
            Variant("true tracks", training={"motion": MotionSettings(tracks="truth")}),
        ),
    ),
    "aggregation": Experiment(
        "aggregation",
        "How plane features are aggregated (paper, table of ACFA's rivals; without DLGD and DACW)",
        tuple(
            _modules(name, name, dlgd=False, dacw=False)
            for name in ("product", "mean", "anchor_only", "time_only", "acfa")
        ),
    ),
}

# What the paper leaves open. The first value of each is the default.
SWEEPS = {
    "gamma": Experiment(
        "gamma",
        "DACW: sensitivity to density",
        tuple(Variant(f"gamma {value:g}", warp={"gamma": value}) for value in (1.0, 0.0, 0.5, 2.0)),
    ),
    "lambda": Experiment(
        "lambda",
        "DACW: bounds of the adaptation strength",
        tuple(
            Variant(f"lambda {low:g} to {high:g}", warp={"lambda_min": low, "lambda_max": high})
            for low, high in ((0.2, 0.8), (0.0, 0.0), (0.0, 0.5), (0.0, 1.0), (0.5, 1.0))
        ),
    ),
    "smoothing": Experiment(
        "smoothing",
        "DACW: smoothing of the histogram, in bins",
        tuple(Variant(f"{value:g} bins", warp={"smoothing": value}) for value in (1.5, 0.0, 4.0)),
    ),
    "time": Experiment(
        "time",
        "Rows of the time planes",
        (Variant("by frames"), *(Variant(f"{rows} rows", {"temporal_resolution": rows}) for rows in (25, 50, 100))),
    ),
    "planes": Experiment(
        "planes",
        "Cells of the planes a side, with and without DACW (no DLGD)",
        tuple(
            Variant(
                f"{coarse} and {fine}{'' if dacw else ', linear'}",
                {"spatial_resolutions": (coarse, fine), "dacw": dacw, "dlgd": False},
            )
            for coarse, fine in ((64, 128), (16, 32))
            for dacw in (True, False)
        ),
    ),
    "embedding": Experiment(
        "embedding",
        "Standard deviation of the embeddings at the start",
        tuple(Variant(f"std {value:g}", training={"embedding_std": value}) for value in (0.01, 0.0, 0.1, 1.0)),
    ),
}
