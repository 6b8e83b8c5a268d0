"""Bayesian filters."""
