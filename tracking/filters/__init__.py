"""Bayesian filters; `base` is the contract of all of them."""
