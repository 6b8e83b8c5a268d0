"""People under ceiling cameras: found in each image, linked on the floor."""
