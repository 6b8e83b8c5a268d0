"""Balls: carried through a room before calibrated cameras, or bouncing and squashed."""
