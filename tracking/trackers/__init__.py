"""The trackers; each file reads like its algorithm."""
