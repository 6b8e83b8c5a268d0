"""Methods of association on given detections: the same boxes for ours, for peers and for the right links."""
