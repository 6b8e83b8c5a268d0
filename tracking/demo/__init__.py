"""The whole path on a generated clip."""
