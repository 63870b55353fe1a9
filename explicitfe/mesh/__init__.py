"""Meshes of 8-node hexahedra: what they are, how they are made, read and judged."""
