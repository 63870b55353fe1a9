"""The emulator of a dataset of markers, from the runs with which its candidates are screened."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from explicitfe.inverse.close_loop.statistics.system import Candidate, Hypothesis
from explicitfe.inverse.close_loop.trajectories.emulator import Emulator, Responses, Vibration, change_of, relative, vibration_of
from explicitfe.inverse.close_loop.trajectories.recordings import Recordings

# Steps of the coordinates of fitted constants from which fast answers are made, such as a fifth of a factor.
BASE_STEP = 0.2


def emulator_near(recordings: Recordings, model: Hypothesis, candidates: Sequence[Candidate]) -> Emulator | None:
    """Fast answers near a model, from the runs with which the candidates are screened; None where nothing vibrates."""
    shifted = {
        parameter.name: [model.shifted(number, step) for step in (-BASE_STEP, BASE_STEP)]
        for number, parameter in enumerate(model.base)
        if parameter.name.partition(".")[0] in recordings.dataset.fit
    }
    tried = {c.effect: [model.plus(c.term, values) for values in c.trials] for c in candidates}
    features: dict[str, Vibration] = {}
    for curve, run in zip(recordings.curves, recordings.runs.of(recordings.jobs(model)), strict=True):
        one = (
            None
            if isinstance(run, str)
            else vibration_of(np.array(recordings.times(curve)), recordings.marker_coordinates(model, run))
        )
        if one is None:
            return None
        features[curve.id] = one
    responses = {}
    for name, models in {**shifted, **tried}.items():
        changes = [_changes_of_features(recordings, one, features) for one in models]
        known = [k for k, change in enumerate(changes) if change is not None]
        if name in shifted:
            coordinates = [np.array([step]) for step in (-BASE_STEP, BASE_STEP)]
        else:
            coordinates = [relative(one.terms[-1].parameters, one.x[-len(one.terms[-1].parameters) :]) for one in models]
        if known:
            by_curve = {c.id: np.array([changes[k][c.id] for k in known]) for c in recordings.curves}  # type: ignore[index]
            responses[name] = Responses(np.array([coordinates[k] for k in known]), by_curve)
    return Emulator(model, features, responses)


def _changes_of_features(
    recordings: Recordings, model: Hypothesis, features: Mapping[str, Vibration]
) -> dict[str, np.ndarray] | None:
    """Change of the features of each curve by a model; None where it cannot be computed or does not vibrate."""
    changes = {}
    for curve, run in zip(recordings.curves, recordings.runs.of(recordings.jobs(model)), strict=True):
        if isinstance(run, str):
            return None
        moved, before = recordings.marker_coordinates(model, run), features[curve.id]
        after = vibration_of(np.array(recordings.times(curve)), moved, before)
        if after is None:
            return None
        changes[curve.id] = change_of(before, after, float(np.abs(moved).max()))
    return changes
