"""How well an image or a measurement agrees with each particle."""
