"""People over one floor, seen by several calibrated cameras."""
