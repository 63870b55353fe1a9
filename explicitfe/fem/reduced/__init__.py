"""Reduced-order models: Galerkin projection on modes of full solutions, with an estimate of the error of the projection."""
