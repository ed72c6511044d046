"""MoDec-GS (Kwak et al., CVPR 2025): anchors deform by intervals of time, then their Gaussians at each time."""
