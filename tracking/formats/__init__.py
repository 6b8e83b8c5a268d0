"""Parsing and writing of every on-disk format, ignore rules included."""
