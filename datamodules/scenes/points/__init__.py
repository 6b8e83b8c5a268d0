"""Coloured objects over clutter, for trackers of an unknown number of targets."""
