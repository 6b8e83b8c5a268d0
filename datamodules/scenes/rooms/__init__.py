"""Rooms seen by fixed cameras."""
