"""A ball in space, from videos or from its measured pixels."""
