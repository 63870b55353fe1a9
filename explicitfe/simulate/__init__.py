"""Simulations: scenarios, anatomy, runs and sweeps."""
