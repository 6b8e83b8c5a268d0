"""One file per paper's experiment: simulate, fit, track, evaluate, table and plot."""
