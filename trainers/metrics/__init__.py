"""Scores as `torchmetrics.Metric`: the sums of `tsuiseki.tracking.evaluation`, which add up over processes."""
