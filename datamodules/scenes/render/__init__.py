"""How a scene becomes a picture: solids, ground, shading, and what a cheap camera does to it."""
