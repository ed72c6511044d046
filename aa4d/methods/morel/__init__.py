"""MoRel (Kwak et al., CVPR 2026): anchors of key frames, each with a deformation over its window of time, blended."""
