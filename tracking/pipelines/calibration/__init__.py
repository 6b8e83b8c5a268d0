"""Cameras from boards and measured points."""
