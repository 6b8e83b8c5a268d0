"""Filters of an unknown number of targets that are measured as points: PHD and labelled multi-Bernoulli."""
