"""SpeeDe3DGS (Tu et al. 2025): D3DGS whose Gaussians are pruned by their sensitivity, and may move in rigid groups."""
