"""Thesis chapter 5: people from a drone, flow alternating with action features."""
