"""Particle filters, and what they are built of: weights, resampling, proposals and weighing in stages."""
