"""Shapes with a pose: the contour that a state draws into the image."""
