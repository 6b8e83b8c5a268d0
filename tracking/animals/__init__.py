"""Several animals before a fixed camera."""
