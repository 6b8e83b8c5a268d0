"""Files of places in the world: paths, positions on a floor, rotated boxes, and points seen by cameras."""
