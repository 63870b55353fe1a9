"""Inverse problems: measured data, predictions, identification of constants, and the search for missing effects."""
