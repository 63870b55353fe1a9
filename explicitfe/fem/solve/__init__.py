"""Solvers: central differences in time, static equilibria, single material points."""
