"""Likelihoods of states given an image."""
