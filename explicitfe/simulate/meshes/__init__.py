"""Mesh files of other programs: their nodes, elements and named sets."""
