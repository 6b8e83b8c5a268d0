"""Articulated people: proportions, poses, clothes, actions, and the things they act with."""
