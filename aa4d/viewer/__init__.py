"""The web viewer, `aa4d view`: pure parts that make a picture for a camera, a thread that draws, and viser's edge."""
