"""Grid4D (Xu et al., NeurIPS 2024): free Gaussians, deformed by a network that sees hashed grids of place and time."""
