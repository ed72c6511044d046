"""The hard cases, one module a part; `aa4d stress` and `test_hard_cases.py` run them."""

import sys
from pathlib import Path

# The helpers of these rooms' tests are modules of their folders.
for room in ("raster", "addon"):
    sys.path.append(str(Path(__file__).parents[1] / room))

# Names of modules, and what they are called on the page.
PARTS = {
    "traffic": "Traffic and car following",
    "flight": "Flight",
    "raster": "Projection and rasterizer",
    "plane_lookup": "Plane look-up and its penalty",
    "acfa": "ACFA",
    "arithmetic": "Networks in bfloat16",
    "dlgd": "DLGD",
    "dacw": "DACW",
    "anchors": "Anchors and their decoding",
    "groups": "Rigid groups and tracks",
    "losses": "Losses and metrics",
    "optimiser": "Optimizer, rates and learned poses",
    "densification": "Growing and pruning",
    "checkpoints": "Checkpoints and tracks of a run",
    "sfm": "Structure from motion",
    "model_file": "The model file",
    "export": "Export",
    "extension": "The Blender extension",
}
