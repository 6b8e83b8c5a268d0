"""Learning the costs of the flow from labelled video."""
