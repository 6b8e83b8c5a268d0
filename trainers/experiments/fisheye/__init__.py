"""Thesis chapter 4: people under ceiling fisheye cameras."""
