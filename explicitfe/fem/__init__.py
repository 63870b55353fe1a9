"""Finite elements for large strains: meshes, laws, elements, effects, forces, bones, solvers, and the model that they compute.

Usable alone; see docs/reference/fem.md.
"""
