"""Meshes of 8-node hexahedra: what a mesh is, what makes one, and how good it is."""
