"""The same person in cameras that do not overlap, and in files that follow each other."""
