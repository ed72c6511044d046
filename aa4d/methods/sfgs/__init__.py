"""4D-SFGS (4D Scaffold Gaussian Splatting, Cho et al. 2024): anchors in space and time, whose Gaussians come and go."""
