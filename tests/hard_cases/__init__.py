"""The hard cases, one module a part; `aa4d stress` and `test_hard_cases.py` run them."""

import sys
from pathlib import Path

# The helpers of these rooms' tests are modules of their folders.
for room in ("raster", "addon"):
    sys.path.append(str(Path(__file__).parents[1] / room))

PARTS = (
    "traffic",
    "flight",
    "raster",
    "plane_lookup",
    "acfa",
    "dlgd",
    "dacw",
    "anchors",
    "groups",
    "losses",
    "optimiser",
    "densification",
    "checkpoints",
    "sfm",
    "model_file",
    "export",
    "extension",
)
