"""Bodies with a shape of their own: skeletons of animals, and fish that bend."""
