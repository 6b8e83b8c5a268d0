"""A run that is watched while it goes on: by events, on a page, in a window, by its health."""
