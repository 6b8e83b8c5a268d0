"""A ball in space."""
