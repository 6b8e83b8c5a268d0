"""Goldfish in a tank, seen from above."""
