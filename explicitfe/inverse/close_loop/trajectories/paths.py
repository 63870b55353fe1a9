"""Paths of markers by models: for the report, and with the likely errors of their places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from explicitfe.fem.mesh.surface_points import outline
from explicitfe.inverse.close_loop.statistics.system import Answer, Hypothesis
from explicitfe.inverse.close_loop.trajectories.markers import rotation_sds
from explicitfe.inverse.close_loop.trajectories.recordings import AXIS_NAMES, Recordings
from explicitfe.inverse.measured.curve import Curve
from explicitfe.platform.errors import RunError
from explicitfe.results.documents.motion_report import MovingMarkers
from explicitfe.results.documents.report_part import Side
from explicitfe.simulate.anatomy.tongue import anatomy_of


def answers_with_errors_of_place(recordings: Recordings, model: Hypothesis) -> dict[str, Answer]:
    """What a model answers with markers, and the axes of the recording, moved by the likely error of their places."""
    runs = [run for run in recordings.runs.of(recordings.jobs(model)) if not isinstance(run, str)]
    sensors = recordings.dataset.sensors
    answers: dict[str, Answer] = {}
    usual = recordings.stand_off(model)
    for number, (name, sensor) in enumerate(sensors.items()):
        for axis in range(3 if not sensor.fixed and sensor.place_sd_m > 0.0 else 0):
            moved = usual.copy()
            moved[number, axis] += sensor.place_sd_m
            seen = {c.id: recordings.seen(model, c, run, moved) for c, run in zip(recordings.curves, runs, strict=True)}
            answers[f"place of {name}, {AXIS_NAMES[axis]}"] = recordings.by_columns(seen)
    places = np.array([sensor.at_m for sensor in sensors.values()])
    sds = rotation_sds(places, np.array([sensor.place_sd_m for sensor in sensors.values()]))
    for axis, sd in enumerate(sds):
        turn = Rotation.from_rotvec(sd * np.eye(3)[axis]).as_matrix()
        seen = {c.id: recordings.seen(model, c, run) @ turn.T for c, run in zip(recordings.curves, runs, strict=True)}
        answers[f"turn of the recording, {AXIS_NAMES[axis]}"] = recordings.by_columns(seen)
    return answers


def moving_markers(recordings: Recordings, curve: Curve, split: Side, before: Hypothesis, after: Hypothesis) -> MovingMarkers:
    """Paths of the markers of a curve from the start of its motion on, as measured and by two models [mm].

    Raises
    ------
    RunError : a model cannot be computed.
    """
    one, paths = recordings.placed[curve.id], []
    moves = [number for number, name in enumerate(recordings.dataset.sensors) if name in recordings.moving]
    alone = replace(recordings, curves=(curve,))
    for model in (before, after):
        (run,) = alone.runs.of(alone.jobs(model))
        if isinstance(run, str):
            raise RunError(run)
        paths.append(1e3 * alone.seen(model, curve, run)[:, moves])
    measured = 1e3 * np.stack([one.displacement(curve, name) for name in recordings.moving], axis=1)
    later = curve.time_s >= one.start_s
    sites = recordings.runs.sites
    mesh = anatomy_of(recordings.scenario.model, recordings.runs.path.parent).mesh
    return MovingMarkers(
        curve=curve.id,
        split=split,
        time_s=curve.time_s[later] - one.start_s,
        names=recordings.moving,
        at_rest=1e3 * (sites.position + sites.stand_off)[moves],
        measured=measured[later],
        before=paths[0][later],
        after=paths[1][later],
        outline=1e3 * outline(mesh),
    )
