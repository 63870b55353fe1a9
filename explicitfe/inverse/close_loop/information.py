"""How much a test would tell about which of several models is right, before it is made.

Each model foretells the rows as a normal distribution: a mean, and what is not known of its parameters. What a test is expected
to tell is the mutual information of model and rows. For mixtures of normal distributions it has no closed form, but a lower
bound by the Bhattacharyya distances of all pairs has (Kolchinsky & Tracey 2017).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

NATS_PER_BIT = float(np.log(2.0))
# Directions in which models foretell less than this share of the largest change are none.
DIFFERING_SHARE = 1e-9


@dataclass(frozen=True, eq=False)
class Foretold:
    """What a model says of rows that are not measured yet, whitened by their noise.

    Attributes
    ----------
    probability : of the model.
    mean : (n,).
    spread : (n, q), one standard deviation of each independent thing that is not known.
    """

    probability: float
    mean: np.ndarray
    spread: np.ndarray


def expected_bits(models: Sequence[Foretold]) -> float:
    """Bits that rows are expected to tell about which model is right; no more than their entropy."""
    p = np.array([m.probability for m in models])
    p = p / p.sum()
    distances = bhattacharyya(models)
    return float(-(p @ np.log(np.exp(-distances) @ p)) / NATS_PER_BIT)


def entropy_bits(probabilities: Sequence[float]) -> float:
    """What is open, in bits."""
    p = np.array([x for x in probabilities if x > 0.0])
    p = p / p.sum()
    return float(-(p @ np.log(p)) / NATS_PER_BIT)


def bhattacharyya(models: Sequence[Foretold]) -> np.ndarray:
    """Bhattacharyya distances (m, m) of what the models foretell."""
    means, spreads = _reduced(models)
    eye = np.eye(means.shape[1])
    covariances = [eye + B @ B.T for B in spreads]
    sizes = [np.linalg.slogdet(S)[1] for S in covariances]
    distances = np.zeros((len(models), len(models)))
    for i in range(len(models)):
        for j in range(i):
            gap, S = means[i] - means[j], 0.5 * (covariances[i] + covariances[j])
            apart = float(gap @ cho_solve(cho_factor(S), gap))
            distance = 0.125 * apart + 0.5 * (np.linalg.slogdet(S)[1] - 0.5 * (sizes[i] + sizes[j]))
            distances[i, j] = distances[j, i] = max(distance, 0.0)
    return distances


def separation(one: Foretold, other: Foretold) -> float:
    """Squared distance of the means over the noise and over what is not known of both models."""
    (a, b), (A, B) = _reduced([one, other])
    S = np.eye(len(a)) + A @ A.T + B @ B.T
    return float((a - b) @ np.linalg.solve(S, a - b))


def _reduced(models: Sequence[Foretold]) -> tuple[np.ndarray, list[np.ndarray]]:
    """Means (m, k) and spreads (k, q) in coordinates of all that differs among the models: elsewhere there is noise alone."""
    first = models[0].mean
    columns = np.column_stack([*(m.mean - first for m in models), *(m.spread for m in models)])
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    U = U[:, s > DIFFERING_SHARE * max(float(s.max(initial=0.0)), 1e-300)]
    return np.array([U.T @ (m.mean - first) for m in models]), [U.T @ m.spread for m in models]
