"""Tracks as a minimum-cost flow through the links of detections."""
