"""Thesis chapter 3: correlation filters selected by particles."""
