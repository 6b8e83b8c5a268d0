"""Several animals seen by a fixed camera: regions that stand out, the pose of each, and who is who."""
