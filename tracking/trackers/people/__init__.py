"""Trackers of people from their detections, online and by network flow."""
