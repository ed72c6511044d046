"""Movers: found in pictures, their tracks, and the rigid groups of anchors that ride on them."""
