"""Labelled video in, training samples out."""
