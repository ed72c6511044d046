"""SD-GS (2025): anchors deform by a field of planes, and grow where they deform."""
