"""4D-GS (Wu et al., CVPR 2024): free Gaussians, deformed by six planes that are multiplied."""
