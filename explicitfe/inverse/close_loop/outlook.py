"""Validate a dataset for ``explicitfe check``, and list the effects that its curves can show."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from explicitfe.fem.effects import EFFECTS
from explicitfe.inverse.close_loop.specimens.features import features_of
from explicitfe.inverse.close_loop.specimens.series import peers_of, series_of
from explicitfe.inverse.close_loop.split import Split, split
from explicitfe.inverse.close_loop.trajectories.markers import place_on_model, remarks
from explicitfe.inverse.measured.contact import about_contact
from explicitfe.inverse.measured.curve import PRINTED_UNITS, Curve, Dataset, Sensor, SpecimenDataset, TrajectoryDataset, sd_of
from explicitfe.inverse.measured.marker_doubts import doubts
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.inverse.measured.units import FAR_FROM_ZERO_SHARE
from explicitfe.results.documents.dataset_check import CheckedCurve, ColumnRange, DatasetCheckReport, HiddenEffect
from explicitfe.simulate.scenario.read import read_transient

_MILLIMETRES_PER_METRE = 1e3


def check_dataset(path: Path | str) -> DatasetCheckReport:
    """Read a dataset; list the fitted and held-out curves and the effects that they can show. Nothing is computed or written.

    Parameters
    ----------
    path : folder of the dataset, its dataset.toml, or the name of a dataset that comes with the program.

    Raises
    ------
    InputError : the dataset or its scenario is invalid.
    """
    dataset = read_dataset(path)
    sides = split(dataset)
    scenario, sensors = (dataset.scenario, dataset.sensors) if isinstance(dataset, TrajectoryDataset) else (None, {})
    if scenario is not None:
        read_transient(scenario)
    specimens = isinstance(dataset, SpecimenDataset) and dataset.of_one_kind
    features = _features(sides.fit) if specimens else set()
    hidden: list[HiddenEffect] = [
        {"effect": name, "needs": kind.about.needs}
        for name, kind in EFFECTS.items()
        if specimens and not set(kind.requires) <= features
    ]
    names = {one["effect"] for one in hidden}
    return {
        "dataset": dataset.name,
        "title": dataset.title,
        "test": dataset.test,
        "file": str(dataset.path),
        "source": dataset.source,
        "license": dataset.license,
        "specimens": _distinct([c.specimen.model_dump(exclude_none=True, mode="json") for c in dataset.curves if c.specimen]),
        "tools": _distinct([c.tool.model_dump(exclude_none=True, mode="json") for c in dataset.curves if c.tool]),
        "scenario": None if scenario is None else str(scenario),
        "sensors": {name: _place_of(sensor) for name, sensor in sensors.items()},
        "rule": f"by close-loop: {sides.rule}{_of_identify(dataset, sides)}",
        "curves": [_checked(curve, sides) for curve in dataset.curves],
        "can_show": [name for name in EFFECTS if specimens and name not in names],
        "cannot_show": hidden,
        "warnings": list(_warnings(dataset, sides)),
    }


def _of_identify(dataset: Dataset, sides: Split) -> str:
    """The curves that close-loop holds out by its rule, and identify fits, in words."""
    held = {curve.id for curve in sides.holdout}
    both = [c.id for c in dataset.curves if c.split is None and c.id in held and isinstance(dataset, SpecimenDataset)]
    return f'; identify fits {_listed(both)} too, unless split = "holdout" is set' if both else ""


def _features(curves: Sequence[Curve]) -> set[str]:
    return features_of(curves, [series_of(curve, curve.id, peers_of(curve, curves)) for curve in curves])


def _place_of(sensor: Sensor) -> str:
    if sensor.at_m is None:
        return sensor.point
    x, y, z = 1e3 * sensor.at_m
    return f"{'fixed at' if sensor.fixed else 'marker at'} ({x:g}, {y:g}, {z:g}) mm"


def _distinct(tables: Sequence[dict[str, object]]) -> list[dict[str, object]]:
    return [table for k, table in enumerate(tables) if table not in tables[:k]]


def _checked(curve: Curve, sides: Split) -> CheckedCurve:
    fitted = curve.id in {c.id for c in sides.fit}
    columns: list[ColumnRange] = []
    for name, values in curve.columns.items():
        unit, factor = PRINTED_UNITS.get(name, ("1", 1.0))
        columns.append({"column": name, "unit": unit, "least": factor * values.min(), "largest": factor * values.max()})
    for name, places in curve.sensors.items():
        first = places[int(np.argmax(np.isfinite(places).all(axis=1)))]
        moved = _MILLIMETRES_PER_METRE * np.linalg.norm(places - first, axis=1)
        largest = float(np.nanmax(moved))
        columns.append({"column": f"{name} from its first position", "unit": "mm", "least": 0.0, "largest": largest})
    noise = _stated_noise(curve)
    return {
        "id": curve.id,
        "file": curve.file,
        "side": "left out" if curve.id in sides.left_out else "fit" if fitted else "holdout",
        "why": sides.left_out.get(curve.id, ""),
        "constants": curve.constants,
        "rows": len(curve.time_s),
        "duration_s": float(curve.time_s[-1]),
        "columns": columns,
        "imposed": curve.imposed if curve.columns else None,
        "noise_sd": noise,
    }


def _stated_noise(curve: Curve) -> float | None:
    """Standard deviation of the predicted column, or of a coordinate in mm, in the unit of the table; None if not stated."""
    if curve.sensors:
        return curve.noise.displacement_sd_mm
    sd = sd_of(curve, curve.predicted)
    return None if sd is None else sd * PRINTED_UNITS.get(curve.predicted, ("1", 1.0))[1]


def _warnings(dataset: Dataset, sides: Split) -> Sequence[str]:
    """Missing information that weakens a verdict."""
    notes = []
    if len(sides.fit) == 1 and not sides.holdout:
        notes.append("there is only one curve, so no prediction can be tested; measure at least one more.")
    elif not sides.holdout:
        notes.append('no curve is held out, so no prediction is tested; set split = "holdout" for one of them.')
    if isinstance(dataset, TrajectoryDataset):
        notes += [note for curve in dataset.curves for note in doubts(curve.file, curve.time_s, curve.sensors)]
        if dataset.scenario is None:
            notes.append("there is no scenario to compare these trajectories with; add the key scenario.")
        elif not dataset.sensors:
            notes.append("no sensor is mapped to a point of the scenario; add a [[sensor]] for each.")
    marked = isinstance(dataset, TrajectoryDataset) and any(sensor.at_m is not None for sensor in dataset.sensors.values())
    if isinstance(dataset, TrajectoryDataset) and marked:  # placed by their rest, where they show their noise
        placed = [(curve, place_on_model(curve, dataset.sensors)) for curve in dataset.curves]
        return [*notes, *(note for curve, one in placed for note in remarks(curve, one, dataset.sensors))]
    unstated = [c.id for c in sides.fit if _stated_noise(c) is None]
    if unstated:
        notes.append(f"the noise of {_listed(unstated)} is not stated; it is estimated from the roughness of the rows.")
    if isinstance(dataset, TrajectoryDataset):
        return notes
    supposed = {
        "the support of the specimen is unknown; it is assumed to slide, as between platens": [
            c for c in _on_unknown_base(sides.fit) if c.tool is not None and c.tool.shape == "platen"
        ],
        "the support of the specimen is unknown; it is assumed to be bonded, as under an indenter": [
            c for c in _on_unknown_base(sides.fit) if c.tool is not None and c.tool.shape != "platen"
        ],
        "the friction of the tool is unknown; it is assumed to be zero, and friction is a candidate effect": [
            c for c in sides.fit if c.tool is not None and c.tool.friction == "unknown"
        ],
    }
    notes += [f"{sentence}." for sentence, curves in supposed.items() if curves]
    notes += [note for curve in sides.fit if (note := about_contact(curve))]
    for curve in sides.fit:
        values = curve.columns[curve.predicted] - (curve.predicted == "stretch")
        if not curve.fit_contact and abs(values[0]) > FAR_FROM_ZERO_SHARE * np.abs(values).max():
            percent = 100.0 * abs(values[0]) / np.abs(values).max()
            notes.append(f"{curve.id} begins at {percent:.0f} % of its largest value; check that it was zeroed before contact.")
    return notes


def _on_unknown_base(curves: Sequence[Curve]) -> list[Curve]:
    return [curve for curve in curves if curve.specimen is not None and curve.specimen.base == "unknown"]


def _listed(names: Sequence[str]) -> str:
    most = 3
    return ", ".join(names) if len(names) <= most else f"{', '.join(names[:most])} and {len(names) - most} more"
