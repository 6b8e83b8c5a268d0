"""Association learnt on whole tracks: labelled flows, losses through the solver, and the training."""
