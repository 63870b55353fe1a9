"""Candidate causes of a trajectory beside muscles and bones, one file each."""
