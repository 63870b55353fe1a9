"""Rigid surfaces in contact with the tongue: triangle surfaces, signed distances, and rigid motion."""
