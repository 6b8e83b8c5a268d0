"""Scores of recognised actions."""
