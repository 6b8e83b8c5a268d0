"""People seen from a drone, and what they do."""
