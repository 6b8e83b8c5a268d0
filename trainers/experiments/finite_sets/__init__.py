"""The finite-set paper: SMC-PHD and labelled filters."""
