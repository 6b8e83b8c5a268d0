"""Chains of detections: their motion, their joining, their gaps and their actions."""
