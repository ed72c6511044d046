"""AdaAnchor4D: dynamic scenes from drone video (ACFA, DLGD, DACW), trained with or without a GPU."""

__version__ = "0.1.0"
