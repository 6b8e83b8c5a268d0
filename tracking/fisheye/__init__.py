"""People under ceiling fisheye cameras."""
