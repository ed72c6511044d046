"""A trained model filmed: camera paths, what to draw, pictures and videos."""
