"""Learning through the flow: labelled flows, losses through the solver, and windows of labelled video."""
