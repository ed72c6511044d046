"""D3DGS (Yang et al., CVPR 2024): free Gaussians that one deep network of place and time deforms."""
