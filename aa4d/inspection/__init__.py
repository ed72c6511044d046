"""Looking inside a trained model: what its aggregation, its warp and its training did."""
