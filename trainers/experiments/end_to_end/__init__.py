"""Costs of the flow learnt through the flow, against costs learnt on pairs and costs set by hand."""
