"""AdaAnchor4D: the paper's method."""
