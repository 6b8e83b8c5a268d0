"""Motion models for particle filters: of bodies in the image, learnt or assumed, and of points in space."""
