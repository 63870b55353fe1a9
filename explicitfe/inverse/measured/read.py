"""Read a dataset from its folder, check it and convert it to SI."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ValidationError

from explicitfe.fem.inputs.table import validated
from explicitfe.inverse.measured.curve import (
    COLUMNS,
    NOISE,
    TIME,
    Curve,
    Dataset,
    Kind,
    Sensor,
    SpecimenDataset,
    TrajectoryDataset,
    check_constants,
    check_sides,
)
from explicitfe.inverse.measured.files import SMALLEST_CURVE_ROWS, CurveCsv, DatasetToml
from explicitfe.inverse.measured.tables import SHAPE_KEYS, CurveTable, DatasetFile, MergedTables, RawTable, SensorTable, TestKind
from explicitfe.inverse.measured.units import check_noise, check_units
from explicitfe.platform.errors import InputError, nearest
from explicitfe.platform.host.shipped import DATASET_FILE, dataset_folder


def read_dataset(path: Path | str) -> Dataset:
    """Read a dataset, in SI units.

    Parameters
    ----------
    path : the folder, the dataset.toml in it, or the name of a dataset that comes with the program.

    Raises
    ------
    InputError : a file cannot be read, or a value is invalid; the message names the file, the line or key, and what to do.
    """
    path = dataset_folder(path)
    with suppress(OSError, ValueError):  # The name may be none that a file can have; opening it says so.
        path = path / DATASET_FILE if path.is_dir() else path
    source = DatasetToml(path)
    try:
        table = validated(DatasetFile, source.data)
    except ValidationError as error:
        raise source.misfit(error, source.data, DatasetFile) from None
    _check_tables(table, source)
    _check_files(table, source)
    curves = tuple(_curve(table, number, source) for number in range(len(table.curve)))
    check_constants(curves, str(source.path))
    check_sides(curves, str(source.path))
    head = {name: getattr(table, name) for name in ("name", "title", "test", "source", "license", "notes")}
    if table.test != "trajectory":
        return SpecimenDataset(**head, path=source.path, curves=curves, rig=table.rig)
    return TrajectoryDataset(
        **head,
        path=source.path,
        curves=curves,
        scenario=None if table.scenario is None else source.path.parent / table.scenario,
        sensors={sensor.name: _sensor(sensor) for sensor in table.sensor},
        registration=table.registration,
        fit=tuple(table.fit),
    )


FEWEST_MARKERS = 3  # that determine a rotation


def _sensor(table: SensorTable) -> Sensor:
    at_m = None if table.at_mm is None else 1e-3 * np.array(table.at_mm)
    return Sensor(table.model_point or "", at_m, table.fixed, 0.0 if at_m is None else 1e-3 * table.place_sd_mm)


def _check_trajectories(table: DatasetFile, source: DatasetToml) -> None:
    owners: list[tuple[tuple[str | int, ...], BaseModel]] = [((), table)]
    owners += [(("curve", number), curve) for number, curve in enumerate(table.curve)]
    for keys, owner in owners:
        for name in ("specimen", "tool", "test") if keys else ("specimen", "tool"):
            if getattr(owner, name):
                raise source.fault((*keys, name), f"a trajectory has no [{name}]; remove it.")
    for name in ("sensor", "registration", "fit"):
        if table.scenario is None and getattr(table, name):
            raise source.fault((name,), f"[{name}] needs a scenario to compare with; add the key scenario.")
    _check_markers(table, source)
    if table.scenario is not None and not (source.path.parent / table.scenario).is_file():
        raise source.fault(
            ("scenario",), f'the scenario "{table.scenario}" is missing; put it into the folder of {source.path.name}.'
        )


def _check_markers(table: DatasetFile, source: DatasetToml) -> None:
    """Refuse markers beside named points, and too few of them to place the body."""
    markers = [number for number, sensor in enumerate(table.sensor) if sensor.at_mm is not None]
    if not markers:
        return
    if len(markers) < len(table.sensor):
        raise source.fault(("sensor", markers[0]), "some sensors have at_mm, others model_point; use one of the two for all.")
    if table.registration is not None:
        raise source.fault(("registration",), "[registration] does not go with at_mm, which gives it; remove it.")
    if len(markers) < FEWEST_MARKERS or all(table.sensor[k].fixed for k in markers):
        raise source.fault(
            ("sensor",),
            f"at least {FEWEST_MARKERS} markers, one of which moves, are needed to place the body; add [[sensor]] tables.",
        )


def _check_specimens(table: DatasetFile, source: DatasetToml) -> None:
    for name in ("scenario", "sensor", "registration", "fit"):
        if getattr(table, name):
            raise source.fault((name,), f'{name} is for test = "trajectory" only; remove it.')
    for number, curve in enumerate(table.curve):
        for name in ("start_s", "until_s"):
            if name in curve.model_fields_set:
                raise source.fault(("curve", number, name), f'{name} is for test = "trajectory" only; remove it.')
    if table.specimen is None and not all(curve.specimen or _of_its_own(curve, table) for curve in table.curve):
        raise source.fault(("test",), '[specimen] is missing; add it, shape = "point" if the size is unknown.')
    tooled = []
    for number, curve in enumerate(table.curve):
        test, own = curve.test or table.test, _of_its_own(curve, table)
        tool = bool(curve.tool) or (table.tool is not None and not own)
        key: tuple[str | int, ...] = ("curve", number, "test") if own else ("test",)
        if test == "indentation" and not tool:
            raise source.fault(key, "an indentation needs a [tool]; add it.")
        if KINDS[test] != "uniaxial" and tool:
            raise source.fault(key, f"a test of kind {test} is a homogeneous state and has no [tool]; remove it.")
        if own and curve.tool and not curve.specimen:
            raise source.fault(key, "a curve of a test of its own needs its own specimen under a tool; add [curve.specimen].")
        tooled += [] if own else [tool]
    if any(tooled) and not all(tooled):
        raise source.fault(("test",), "some curves of the test have a tool, others none; add a [tool] for all.")


# Kinds of curves without a tool.
KINDS: dict[TestKind, Kind] = {
    "indentation": "uniaxial",
    "compression": "uniaxial",
    "tension": "uniaxial",
    "equibiaxial": "equibiaxial",
    "planar": "planar",
    "shear": "shear",
    "trajectory": "trajectory",
}


def _check_tables(table: DatasetFile, source: DatasetToml) -> None:
    """Raise InputError where the test lacks a table or has one that it cannot have, or where a name is used twice."""
    (_check_trajectories if table.test == "trajectory" else _check_specimens)(table, source)
    for array, key in (("sensor", "name"), ("curve", "id"), ("curve", "file")):
        names = [getattr(entry, key) for entry in getattr(table, array)]
        for number, name in enumerate(names):
            first = names.index(name)
            if first != number:
                sentence = f'two {array}s have the {key} "{name}", numbers {first + 1} and {number + 1}; give each a unique one.'
                raise source.fault((array, number, key), sentence)


def _check_files(table: DatasetFile, source: DatasetToml) -> None:
    """Raise InputError unless every curve has its CSV, and every CSV of the folder its curve."""
    folder = source.path.parent
    files = {entry.name for entry in folder.iterdir() if entry.is_file() and not entry.name.startswith(".")}
    unlisted = sorted(name for name in files - {curve.file for curve in table.curve} if name.lower().endswith(".csv"))
    for number, curve in enumerate(table.curve):
        if curve.file not in files:
            hint = nearest(curve.file, unlisted) if unlisted else f"put it into the folder of {source.path.name}."
            raise source.fault(("curve", number, "file"), f'the file "{curve.file}" of curve "{curve.id}" is missing; {hint}')
    if unlisted:
        raise InputError(f"{folder / unlisted[0]}: no curve of {source.path.name} has this file; add one or remove the file.")


def _curve(table: DatasetFile, number: int, source: DatasetToml) -> Curve:
    entry = table.curve[number]
    setup = _setup(table, number, source)
    kind = _kind(table, entry)
    if setup.tool is not None and setup.specimen is not None and setup.specimen.shape == "point":
        raise source.fault(("specimen", "shape"), 'a specimen of shape "point" cannot have a [tool]; give its dimensions.')
    if entry.contact is not None and (setup.tool is None or setup.tool.shape == "bonded-disc"):
        raise source.fault(("curve", number, "contact"), "contact is for a tool that comes into contact; remove it.")
    csv = CurveCsv(source.path.parent / entry.file, kind, [sensor.name for sensor in table.sensor])
    check_units(csv, setup)
    check_noise(csv, setup, table, number, source)
    time_s, used = csv.data[TIME], slice(None)
    if entry.until_s is not None:
        used = slice(int(np.searchsorted(time_s, entry.until_s, side="right")))
    if len(time_s[used]) < SMALLEST_CURVE_ROWS:
        raise source.fault(("curve", number, "until_s"), f"fewer than {SMALLEST_CURVE_ROWS} rows are left; increase until_s.")
    si = {name: factor * csv.data[column] for column, (name, factor) in COLUMNS.get(kind, {}).items()}
    return Curve(
        id=entry.id,
        file=entry.file,
        kind=kind,
        constants=entry.constants,
        group=entry.id if entry.group is None else entry.group,
        split=entry.split,
        specimen=setup.specimen,
        tool=setup.tool,
        noise=setup.noise,
        conditions=entry.conditions,
        time_s=time_s[used],
        columns=si,
        sensors={name: 1e-3 * position[used] for name, position in csv.sensors().items()},
        start_s=None if entry.start_s == "fit" else entry.start_s,
        fit_contact=entry.contact is not None,
    )


def _merged(common: RawTable | None, own: RawTable) -> RawTable | None:
    """A table of the dataset with the curve's own keys over it; keys of another shape do not carry over."""
    if common is None:
        return own or None
    if "shape" in own and own["shape"] != common.get("shape"):
        common = {key: value for key, value in common.items() if key not in SHAPE_KEYS}
        if isinstance(common.get("assumed"), list):
            common["assumed"] = [key for key in common["assumed"] if key not in SHAPE_KEYS]
    return common | own


def _of_its_own(curve: CurveTable, table: DatasetFile) -> bool:
    """Whether a curve is of another test than the dataset, whose specimen and tool are not its own."""
    return curve.test not in (None, table.test)


def _kind(table: DatasetFile, curve: CurveTable) -> Kind:
    tool = curve.tool or (None if _of_its_own(curve, table) else table.tool)
    return KINDS[curve.test or table.test] if tool is None else "force-displacement"


def _setup(table: DatasetFile, number: int, source: DatasetToml) -> MergedTables:
    entry = table.curve[number]
    common = {"specimen": table.specimen, "tool": table.tool, "noise": table.noise}
    if _of_its_own(entry, table):
        possible = {*NOISE[_kind(table, entry)], "repeat_sd_fraction"}
        noise = {key: value for key, value in table.noise.items() if key in possible}
        common = {"specimen": None if entry.tool or entry.specimen else {"shape": "point"}, "tool": None, "noise": noise}
    merged = {name: _merged(given, getattr(entry, name)) for name, given in common.items()}
    try:
        return validated(MergedTables, merged)
    except ValidationError as error:

        def own(keys: Sequence[str | int]) -> bool:
            table_of_curve = getattr(entry, str(keys[0]))
            return bool(table_of_curve) and (len(keys) == 1 or keys[1] in table_of_curve or not source.data.get(str(keys[0])))

        def place(keys: Sequence[str | int]) -> Sequence[str | int]:
            return ("curve", number, *keys) if own(keys) else keys

        touched = any(getattr(entry, str(problem["loc"][0])) for problem in error.errors())
        raise source.misfit(error, merged, MergedTables, place, f'curve "{entry.id}": ' if touched else "") from None
