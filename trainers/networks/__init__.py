"""Training of the networks: detector, appearance and action."""
