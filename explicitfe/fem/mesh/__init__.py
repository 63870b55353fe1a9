"""Meshes of 8-node hexahedra: data structure, generators, and quality."""
