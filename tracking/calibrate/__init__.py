"""Where cameras are and how they see."""
