"""Answers from tracks: who crossed which line, who was in which zone for how long, and how sure that is."""
