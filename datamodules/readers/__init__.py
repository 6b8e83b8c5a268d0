"""One file per on-disk data set: parsed labels turned into training samples; no torch."""
