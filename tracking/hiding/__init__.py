"""People hidden in a video that was tracked."""
