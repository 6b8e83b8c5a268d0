"""Learning how bodies look and move, from silhouettes and tracks."""
