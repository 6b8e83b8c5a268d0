"""Correlation filters: where the target is in a search window, and how large it is."""
