"""Forward-mode derivatives of a run by muscle forces and constants; each SIMD lane holds one direction."""
