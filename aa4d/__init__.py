"""AdaAnchor4D: dynamic scenes from drone video (ACFA, DLGD, DACW), trained on CUDA or on a CPU rasteriser of its own."""

__version__ = "0.1.0"
