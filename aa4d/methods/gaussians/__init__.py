"""Free Gaussians (3DGS): what each owns, its color by direction, and how it is cloned, split and pruned."""
