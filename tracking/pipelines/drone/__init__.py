"""People seen from a drone: what each frame shows of them, then how they are linked."""
