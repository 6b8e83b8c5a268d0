"""Inference, tracking and evaluation; never imports torch or lightning."""
