"""Derivatives of a run by muscle forces and constants: what is advanced beside it, in lanes of directions."""
