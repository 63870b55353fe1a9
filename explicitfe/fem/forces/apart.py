"""Surfaces that do not touch each other: what kernels call in place of ``surfaces.py`` where a model has no such contact."""

from __future__ import annotations

from explicitfe.platform.compiled.jit import leaf


@leaf
def add_surfaces(force, u, v, surfaces, nodes, gain):
    """No force and no energy."""
    return 0.0


@leaf
def surfaces_loss(surfaces, v, behind, ahead):
    """No loss."""
    return 0.0


@leaf
def add_surfaces_stiffness(force, u, here, surfaces):
    """No stiffness."""


@leaf
def add_surface_pressure(surfaces, pressure, pairs):
    """No pressure."""
