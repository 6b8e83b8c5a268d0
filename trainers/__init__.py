"""Fitting the networks and the classical learners, and exporting them to ONNX."""
