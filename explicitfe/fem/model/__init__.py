"""The model that a solver computes: mesh, material, boundary conditions, loads and effects. Nothing here is compiled."""
