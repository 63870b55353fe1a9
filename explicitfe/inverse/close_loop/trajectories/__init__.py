"""Sensors on a moving tongue as the loop sees them."""
