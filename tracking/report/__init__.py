"""Overlays, pages, plots."""
