"""`aa4d eval`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from rich.table import Table
from tyro.conf import Positional, arg

from aa4d.commands.choices import name_in, names_in
from aa4d.console import console, step_progress
from aa4d.words import counted


def evaluate(
    run: Annotated[Positional[Path], arg(help="Folder of a run, made by `aa4d train`.")],
    capture: Annotated[
        Path | None, arg(metavar="PATH", help="Capture folder, where it has moved since training.")
    ] = None,
    lpips: Annotated[
        tuple[str, ...] | None,
        names_in("aa4d.evaluation.lpips", "STACKS", "--lpips", "none but alex, if it is at hand"),
        arg(
            help="LPIPS by these networks. Weights are looked for in $AA4D_WEIGHTS, or in the caches of aa4d and of "
            "torch.hub, and downloaded if absent (alex 233 MiB, squeeze 5 MiB, vgg 528 MiB).",
        ),
    ] = None,
    device: Annotated[
        str,
        name_in("aa4d.device", "DEVICES", "--device"),
        arg(help="auto: the CPU, until CUDA has trained on a real GPU."),
    ] = "auto",
) -> None:
    """Score a run on the held-out frames and time its rendering; writes metrics.json and eval/ into the run."""
    from aa4d.device import note_on_device
    from aa4d.evaluation.evaluate import evaluate as run_evaluation
    from aa4d.evaluation.lpips_weights import obtain

    with step_progress("weights of LPIPS") as progress:
        perceptual = obtain(lpips, progress)
    if note := note_on_device(device):  # type: ignore[arg-type]
        console.print(note, highlight=False, soft_wrap=True)
    with step_progress("frames") as progress:
        metrics = run_evaluation(run, capture, progress, perceptual, device=device)  # type: ignore[arg-type]
    console.print(metrics_table(metrics.as_json()))
    for reason in not_measured(metrics.as_json()):
        console.print(reason, highlight=False, soft_wrap=True)
    console.print(f"metrics: {run / 'metrics.json'}\nrenders: {run / 'eval'}", highlight=False, soft_wrap=True)


def metrics_table(metrics: dict[str, Any]) -> Table:
    """Quality beside cost, the full model beside itself frozen at its coarse stage."""
    table = Table(title="held-out frames")
    table.add_column("")
    table.add_column(metrics.get("method", "model"), justify="right")
    table.add_column("coarse (static)", justify="right")

    def db(value: float | None) -> str:
        return "not measured" if value is None else f"{value:z.2f} dB"

    table.add_row("PSNR", db(metrics["psnr"]), db(metrics["psnr_static"]))
    table.add_row("PSNR, moving pixels", db(metrics["psnr_dynamic"]), db(metrics["psnr_dynamic_static"]))
    table.add_row("PSNR, still pixels", db(metrics["psnr_still"]), "")
    for name, value in metrics["psnr_activity"].items():
        share = f"{100 * metrics['activity_share'][name]:.1f} % of pixels"
        table.add_row(f"PSNR, {name} ({share})", db(value), db(metrics["psnr_activity_static"].get(name)))
    if metrics.get("psnr_swept") is not None:
        beside = db(metrics["psnr_swept_static"])
        table.add_row("PSNR, ground that movers drive over at another time", db(metrics["psnr_swept"]), beside)
    table.add_row("SSIM", f"{metrics['ssim']:.4f}", "")
    for network, value in metrics["lpips"].items():
        table.add_row(f"LPIPS ({network})", f"{value:.4f}", "")
    for network in metrics["lpips_not_measured"]:
        table.add_row(f"LPIPS ({network})", "not measured", "")
    for label, value, beside in motion_rows(metrics):
        table.add_row(label, value, beside)
    if metrics.get("activity_rank_correlation") is not None:
        table.add_row(
            "weights on planes with time against true activity, rank",
            f"{metrics['activity_rank_correlation']:z.2f}",
            "",
        )
    for label, value in second_drone_rows(metrics):
        table.add_row(label, value, "")
    table.add_row("PSNR of training frames", db(metrics["psnr_training"]), "")
    width, height = metrics["resolution"]
    where = "GPU" if metrics["device"] == "cuda" else counted(metrics["threads"], "thread")
    table.add_row(f"rendering, {width}x{height}, {where}", f"{metrics['fps']:.1f} fps", "")
    if metrics["fps_cached"] is not None:
        table.add_row(f"rendering from a cache ({metrics['cache']})", f"{metrics['fps_cached']:.1f} fps", "")
    table.add_row("training", f"{metrics['training_seconds'] / 60:.1f} min", "")
    table.add_row("anchors (free Gaussians) / Gaussians drawn", f"{metrics['anchors']} / {metrics['gaussians']}", "")
    table.add_row("neural size / model file", f"{metrics['neural_mib']:.2f} / {metrics['total_mib']:.2f} MiB", "")
    return table


def not_measured(metrics: dict[str, Any]) -> list[str]:
    """Why a network's LPIPS is missing, a sentence each."""
    return [f"LPIPS ({network}) not measured: {reason}" for network, reason in metrics["lpips_not_measured"].items()]


def second_drone_rows(metrics: dict[str, Any]) -> list[tuple[str, str]]:
    """Rows of the table on views from elsewhere, where the capture has them: label, value."""
    scores = metrics.get("second_drone")
    if scores is None:
        return []
    share = scores["seen_share"]
    labels = {
        "psnr": "",
        "psnr_seen": "" if share is None else f", what training shows ({100 * share:.0f} % of pixels)",
        "psnr_dynamic": ", moving pixels",
        "psnr_training_times": ", at times of training",
        "psnr_held_out_times": ", at held-out times",
    }
    values = ((label, scores[key]) for key, label in labels.items())
    return [(f"PSNR, second drone{label}", f"{value:.2f} dB") for label, value in values if value is not None]


def motion_rows(metrics: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Of the table: label, value, value where nothing but the camera moves. What was not measured has no row."""

    def px(value: float | None) -> str:
        return "" if value is None else f"{value:.2f} px"

    rows = []
    if metrics["motion_epe_px"] is not None:
        rows.append(("motion, end-point error", px(metrics["motion_epe_px"]), px(metrics["motion_epe_px_static"])))
        rows.append(("motion, end-point error, median", px(metrics["motion_epe_px_median"]), ""))
    if metrics["travel_ratio"] is not None:
        label = f"drawn travel / true travel (instances: {metrics['travel_instances']})"
        rows.append((label, f"{100 * metrics['travel_ratio']:.0f} %", "0 %"))
    if metrics["groups"]:
        found = f"{metrics['groups_matched']} of {metrics['moving_instances']} moving instances"
        known = metrics["moving_instances"] is not None
        rows.append(("rigid groups", f"{metrics['groups']}" + (f", {found}" if known else ""), ""))
    if metrics["track_recall"] is not None:
        wrong = f"vehicles missed: {metrics['vehicles_missed']}, false tracks: {metrics['tracks_false']}"
        rows.append((f"vehicle-frames on a track ({wrong})", f"{100 * metrics['track_recall']:.0f} %", ""))
    if metrics["group_error_m"] is not None:
        rows.append(("error of their trajectories, median", f"{metrics['group_error_m']:.2f} m", ""))
    if metrics["flow_agreement_px"] is not None:
        beside = px(metrics["flow_agreement_px_static"])
        rows.append(("motion against optical flow, median", px(metrics["flow_agreement_px"]), beside))
    return rows
