"""Checked input values: tables of text files, bounds by unit, and numbers of Python callers."""
