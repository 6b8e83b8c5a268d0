"""Motion between frames: of every pixel, and of the camera."""
