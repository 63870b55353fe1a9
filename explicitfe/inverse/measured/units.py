"""Plausibility of the numbers of a curve: a value far outside the range of soft tissue is in another unit."""

from __future__ import annotations

import math

import numpy as np

from explicitfe.inverse.measured.curve import COLUMNS, NOISE, TIME
from explicitfe.inverse.measured.files import CurveCsv, DatasetToml
from explicitfe.inverse.measured.tables import DatasetFile, MeasuredSpecimen, MeasuredTool, MergedTables
from explicitfe.platform.errors import InputError

# All limits are wide: a curve that is merely unusual must pass.
_STRETCH_LIMITS = (0.05, 50.0)
_LARGEST_FIRST_STRETCH = 10.0
_LARGEST_SHEAR_STRAIN = 10.0
# A displacement given in metres is a thousandth of the one in mm: it stays below these shares of the specimen's thickness and of
# the tool's radius.
_METRES_THICKNESS_SHARE = 1e-3
_METRES_RADIUS_SHARE = 1e-2
_LARGEST_SOFT_STIFFNESS_PA = 1e6  # With a displacement in metres the stiffness of 30 Pa seems to be so large.
_LARGEST_PULL_THICKNESSES = 10.0
_PRESSURE_LIMITS_PA = (1.0, 1e8)
_STRESS_LIMITS_PA = (1e-2, 1e9)
_STIFFNESS_LIMITS_PA = (10.0, 1e9)  # Stiffness is the largest stress over the largest strain.
# A first value beyond this share of the largest one is no zero that drifts.
FAR_FROM_ZERO_SHARE = 0.05
_COORDINATE_LIMITS_MM = (0.2, 5000.0)


def check_units(csv: CurveCsv, setup: MergedTables) -> None:
    """Raise InputError where values can only be right in another unit."""
    if csv.kind == "force-displacement":
        assert setup.specimen is not None and setup.tool is not None
        _check_tool_curve(csv, setup.specimen, setup.tool)
    elif sensors := csv.sensors():
        low, high = _COORDINATE_LIMITS_MM
        coordinates = np.column_stack(list(sensors.values()))
        missing = np.isnan(coordinates).all(axis=0)
        if missing.any():
            sensor = list(sensors)[int(missing.argmax()) // 3]
            raise InputError(f'{csv.path}: sensor "{sensor}" has no value in any row; remove its columns.')
        largest = np.nan_to_num(np.abs(coordinates)).max(axis=1)
        row = int(largest.argmax())
        if largest[row] < low:
            raise csv.fault(row, f"the largest coordinate is {largest[row]:.3g} mm, too small; give mm.")
        places = coordinates.reshape(-1, 3)
        extent = float(np.linalg.norm(np.nanmax(places, axis=0) - np.nanmin(places, axis=0)))
        if extent > high:  # the origin may be far from the sensors
            raise csv.fault(row, f"the coordinates extend over {extent:.3g} mm, too much; give mm.")
    else:
        _check_homogeneous(csv)


def _check_homogeneous(csv: CurveCsv) -> None:
    first, second = COLUMNS[csv.kind]
    deformation, stress = csv.data[first], np.abs(csv.data[second])
    if first == "stretch":
        low, high = _STRETCH_LIMITS
        # At rest a stretch is 1; in percent it is 100, and a strain is 0.
        odd = (deformation <= low) | (deformation >= high)
        odd[0] |= deformation[0] >= _LARGEST_FIRST_STRETCH
        advice = "give current length over length at rest (1 at rest), not percent"
        if not odd[0] and odd.any() and deformation[int(odd.argmax())] > low:
            advice = f"stretches above {high:g} are not supported; omit these rows"
        strain = np.abs(deformation - 1.0)
    else:
        odd, advice = np.abs(deformation) > _LARGEST_SHEAR_STRAIN, "give the tangent of the angle, not percent"
        strain = np.abs(deformation)
    if odd.any():
        row = int(odd.argmax())
        raise csv.fault(row, f"{first} = {deformation[row]:g} is not possible; {advice}.")
    row, low, high = int(stress.argmax()), *_STRESS_LIMITS_PA
    if not low <= stress[row] <= high:
        raise csv.fault(row, f"the largest {second} is {stress[row]:.3g} Pa, too {_extent(stress[row], low)}; give Pa.")
    _check_stiffness(csv, second, row, stress[row], strain.max(), "give Pa")


def _check_tool_curve(csv: CurveCsv, specimen: MeasuredSpecimen, tool: MeasuredTool) -> None:
    displacement, force = csv.data["displacement_mm"], np.abs(csv.data["force_N"])
    thickness, radius = specimen.thickness_mm, tool.radius_mm
    deepest, highest = int(displacement.argmax()), int(displacement.argmin())
    if displacement[deepest] >= thickness:
        sentence = f"displacement_mm = {displacement[deepest]:g} is deeper than the specimen is high, {thickness:g} mm"
        raise csv.fault(deepest, f"{sentence}; give both in mm.")
    if displacement[highest] < -_LARGEST_PULL_THICKNESSES * thickness:
        sentence = f"displacement_mm = {displacement[highest]:g} pulls a specimen of {thickness:g} mm"
        raise csv.fault(highest, f"{sentence} to over {_LARGEST_PULL_THICKNESSES:g} times its height; give both in mm.")
    farthest = int(np.abs(displacement).argmax())
    largest = abs(displacement[farthest])
    if radius is None:
        area, strain = specimen.face_mm2, largest / thickness
    else:
        contact = min(radius, math.sqrt(2.0 * radius * max(largest, 1e-9))) if tool.shape == "sphere" else radius
        area, strain = math.pi * contact**2, largest / contact
    row, low, high = int(force.argmax()), *_PRESSURE_LIMITS_PA
    pressure = force[row] / (1e-6 * area)
    # A small indenter needs only a small dent, whatever the height of the specimen; a sphere in tissue shows no large stiffness.
    small = largest < _METRES_THICKNESS_SHARE * thickness and (radius is None or largest < _METRES_RADIUS_SHARE * radius)
    if small and not (tool.shape == "sphere" and pressure < _LARGEST_SOFT_STIFFNESS_PA * strain):
        sentence = f"the largest displacement_mm is {largest:.3g}, too small for a specimen of {thickness:g} mm"
        raise csv.fault(farthest, f"{sentence}; give it in mm.")
    if not low <= pressure <= high:
        sentence = f"the largest force_N, {force[row]:.3g}, is {pressure:.3g} Pa on {area:.3g} mm2, too {_extent(pressure, low)}"
        raise csv.fault(row, f"{sentence}; give N, and lengths in mm.")
    _check_stiffness(csv, "force_N", row, pressure, strain, "give N, and lengths in mm")


def _check_stiffness(csv: CurveCsv, column: str, row: int, stress: float, strain: float, advice: str) -> None:
    low, high = _STIFFNESS_LIMITS_PA
    # A specimen that is held at rest shows no stiffness.
    if strain > 0.0 and not low <= stress / strain <= high:
        sentence = (
            f"the largest {column} means a stiffness of about {stress / strain:.2g} Pa, too {_extent(stress / strain, low)}"
        )
        raise csv.fault(row, f"{sentence} for anything soft; {advice}.")


def _extent(value: float, low: float) -> str:
    return "small" if value < low else "large"


def check_noise(csv: CurveCsv, setup: MergedTables, table: DatasetFile, number: int, source: DatasetToml) -> None:
    possible = NOISE[csv.kind]
    curve = table.curve[number]
    for key in setup.noise.model_fields_set - {"repeat_sd_fraction"}:
        keys = ("curve", number, "noise", key) if key in curve.noise else ("noise", key)
        if key not in possible:
            valid = ", ".join([*possible, "repeat_sd_fraction"])
            raise source.fault(keys, f'[noise] {key} is not for curve "{curve.id}"; possible keys are {valid}.')
        columns = [possible[key]] if possible[key] in csv.data else [name for name in csv.data if name != TIME]
        largest = max(np.abs(csv.data[column] - (column == "stretch")).max() for column in columns)
        sd = getattr(setup.noise, key)
        # A stretch that is held at 1 has no size to compare with.
        if sd > largest > 0.0:
            sentence = f"[noise] {key} = {sd:g} exceeds the largest value of {possible[key]} in {curve.file}, {largest:.3g}"
            raise source.fault(keys, f"{sentence}; give the standard deviation of one row in the key's unit.")
