"""What the web viewer takes, in a real browser: `python -m tests.benchmarks.viewer RUN [--json FILE]`.

Latency is from the key going down to the picture's arrival on the (software) GPU of the page; pictures a second are
those that arrive while the clip plays. Both depend on what else the machine does, so its load is measured too.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from pathlib import Path
from typing import Any

from aa4d.files import write_json
from aa4d.viewer.drawing import Drawing
from aa4d.viewer.following import Followed
from aa4d.viewer.page import Page
from aa4d.viewer.server import serve
from tests.browser import launched, watched

WIDTH, HEIGHT = 640, 360
PRESSES = 15
PLAYED_S = 15.0
PATIENCE_MS = 60_000
HAS_WHOLE = f"pictures.some(p => p[1] == {WIDTH})"
WATCH = """
window.keys = []; window.pictures = [];
window.addEventListener("keydown", () => window.keys.push(performance.now()), true);
for (const name of ["texImage2D", "texSubImage2D"]) {
  const upload = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function (...given) {
    const image = given[given.length - 1];
    const result = upload.apply(this, given);
    if (image && image.width > 100) window.pictures.push([performance.now(), image.width]);
    return result;
  };
}
"""


def measure(run: Path) -> dict[str, Any]:
    shown = Followed(run, None).load()
    drawing, server = Drawing((shown,)), serve("127.0.0.1", 0)
    page = Page(server, drawing)
    drawing.start()
    address = f"127.0.0.1:{server.get_port()}"
    try:
        with launched() as browser, watched(browser, WIDTH, HEIGHT, allowed=address) as seen:
            seen.page.add_init_script(WATCH)
            seen.page.goto(f"http://{address}")
            seen.page.wait_for_function(HAS_WHOLE, timeout=PATIENCE_MS)
            first, sharp = [], []
            for _ in range(PRESSES):
                time.sleep(0.5)
                seen.page.evaluate("keys.length = pictures.length = 0")
                seen.page.keyboard.press("n")
                seen.page.wait_for_function(HAS_WHOLE, timeout=PATIENCE_MS)
                pressed, pictures = seen.page.evaluate("[keys[0], pictures]")
                first.append(pictures[0][0] - pressed)
                sharp.append(next(at for at, width in pictures if width == WIDTH) - pressed)
            seen.page.evaluate("pictures.length = 0")
            used, began = time.process_time(), time.monotonic()
            page._toggle_play()
            time.sleep(PLAYED_S)
            page._toggle_play()
            passed = time.monotonic() - began
            used = time.process_time() - used
            pictures = seen.page.evaluate("pictures")
    finally:
        drawing.stop()
        server.stop()
    return {
        "run": run.name,
        "width": WIDTH,
        "height": HEIGHT,
        "latency_ms": round(statistics.median(first)),
        "latency_longest_ms": round(max(first)),
        "sharp_ms": round(statistics.median(sharp)),
        "pictures_a_second": round(len(pictures) / passed, 1),
        "width_while_playing": round(statistics.median(width for _, width in pictures)),
        "processor_ms_a_picture": round(1e3 * used / max(len(pictures), 1)),
        "load": round(os.getloadavg()[0], 1),
        "cores": os.cpu_count(),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    measured = measure(given.run)
    for key, value in measured.items():
        print(f"{key}: {value}")
    if given.json is not None:
        write_json(given.json, measured)


if __name__ == "__main__":
    main()
