"""Models that learn a camera from its unlabelled video."""
