"""Synthetic labelled video with exact truth: articulated people over a textured ground, seen by a camera."""
