"""Everyone in view."""
