"""Linking detections into tracks: assignment, costs and min-cost flow."""
