"""Learning the objectness model."""
