"""The frame of a run: its source and options, progress, signals, and what happens to the result."""
