"""What the page that plays a scene takes, in a real browser: `python -m tests.benchmarks.page RUN [--json FILE]`.

Pictures a second are counted by the page's clock, in a window of 640x360: as it plays, where the resolution follows
what the machine can do, and held at full resolution. Both depend on what else the machine does; the processor's time
for a picture, of all of Chromium's processes, does less so. Pictures at rest, in the capture's own size, are held
against `aa4d render` at the held-out frames.
"""

from __future__ import annotations

import argparse
import io
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from playwright.sync_api import Browser, Page

from aa4d.errors import InputError
from aa4d.export import export
from aa4d.export.clip import Clip
from aa4d.export.html_page import NAME
from aa4d.files import write_json
from aa4d.filming.camera_path import path_of_frames
from aa4d.filming.layers import draw
from aa4d.methods.model_file import load_model
from tests.browser import launched, watched

WIDTH, HEIGHT = 640, 360
PAINTERS = ("cpu", "gpu")  # as the page's address names them; the second is drawn by SwiftShader
SETTLING_MS, PLAYED_MS = 4000, 12_000
PATIENCE_MS = 300_000
HIDE = "for (const e of document.querySelectorAll('#bar, #title')) e.style.display = 'none'"
BEGIN = """async ([settling, full]) => {
  const p = await player;
  if (full) Object.defineProperty(p, "scale", { get: () => 1, set() {}, configurable: true });
  p.play();
  await new Promise((done) => setTimeout(done, settling));
}"""
COUNT = """async (played) => {
  const p = await player, before = p.pictures, began = performance.now();
  await new Promise((done) => setTimeout(done, played));
  return [p.pictures - before, (performance.now() - began) / 1000, p.view.lens.width];
}"""
END = "async () => { const p = await player; p.play(false); await p.settled(); }"


def measure(run: Path) -> list[dict[str, Any]]:
    """A row for each painter."""
    loaded = load_model(run / "model.safetensors")
    clip = Clip(loaded, path_of_frames(loaded, "all"), None)
    rows = []
    with tempfile.TemporaryDirectory() as folder, launched() as browser:
        export(clip, "html", Path(folder, "page"), lambda *_: None)
        file = Path(folder, "page", NAME)
        for painter in PAINTERS:
            row = {"run": run.name, "painter": painter, "mb": file.stat().st_size / 1e6}
            rows.append(row | decibels(browser, file, painter, clip) | played(browser, file, painter))
            print(rows[-1], flush=True)
    return rows


def played(browser: Browser, file: Path, painter: str) -> dict[str, float]:
    found: dict[str, float] = {}
    with watched(browser, WIDTH, HEIGHT) as seen:
        opened(seen.page, file, painter)
        for kind, full in (("", False), ("full_", True)):
            seen.page.evaluate(BEGIN, [SETTLING_MS, full])
            used = processor_s()
            pictures, seconds, width = seen.page.evaluate(COUNT, PLAYED_MS)
            used = processor_s() - used
            seen.page.evaluate(END)
            found |= {f"{kind}pictures_a_second": pictures / seconds, f"{kind}width": width}
            found[f"{kind}processor_ms"] = 1e3 * used / max(pictures, 1)
    assert found["full_width"] == WIDTH
    return found | {"load": os.getloadavg()[0]}


def processor_s() -> float:
    """Seconds of the processor that the processes below this one, the browser's, have used."""
    parents, used = {}, {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:  # it has just ended
            continue
        parents[folder.name], used[folder.name] = fields[1], int(fields[11]) + int(fields[12])
    below = {str(os.getpid())}
    while more := {child for child, parent in parents.items() if parent in below} - below:
        below |= more
    return sum(used[process] for process in below - {str(os.getpid())}) / os.sysconf("SC_CLK_TCK")


def decibels(browser: Browser, file: Path, painter: str, clip: Clip) -> dict[str, float]:
    """Means over the held-out frames: the page against `aa4d render`, and both against the capture's own pictures."""
    capture = clip.loaded.capture_folder
    if capture is None:
        raise InputError(f"{clip.loaded.path}: its capture is not known, so there is no truth to compare with")
    camera, rows = clip.path.camera, []
    with watched(browser, camera.width, camera.height) as seen:
        opened(seen.page, file, painter)
        seen.page.evaluate(HIDE)
        for index, frame in enumerate(clip.loaded.frames):
            if frame.split == "test":
                seek = "async (s) => { const p = await player; p.seek(s); await p.settled(); }"
                seen.page.evaluate(seek, clip.seconds(index))
                shot = np.array(Image.open(io.BytesIO(seen.page.screenshot())).convert("RGB"))
                model = draw(clip.loaded, clip.path.views[index], camera, ["color"]).color
                truth = np.array(Image.open(capture / frame.image).convert("RGB"))
                rows.append([psnr(shot, model), psnr(shot, truth), psnr(model, truth)])
    names = ("against_render_db", "against_truth_db", "render_against_truth_db")
    return dict(zip(names, np.mean(rows, axis=0).tolist(), strict=True))


def psnr(first: np.ndarray, second: np.ndarray) -> float:
    return -10 * float(np.log10(max(np.mean((first / 255 - second / 255) ** 2), 1e-12)))


def opened(page: Page, file: Path, painter: str) -> None:
    page.set_default_timeout(PATIENCE_MS)
    page.goto(f"{file.as_uri()}#play=off&painter={painter}")
    page.wait_for_selector("body.ready")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    rows = measure(given.run)
    if given.json is not None:
        write_json(given.json, {"rows": rows})


if __name__ == "__main__":
    main()
