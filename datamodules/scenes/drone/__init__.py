"""Gatherings of acting people seen from a drone."""
