"""The goldfish paper: particles from learnt correlations of shape and motion."""
