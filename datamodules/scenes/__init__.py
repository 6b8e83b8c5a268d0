"""Synthetic labelled video with exact truth; no torch."""
