"""A ball in space from calibrated cameras."""
