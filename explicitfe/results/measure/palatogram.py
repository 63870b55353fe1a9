"""Contact of tongue and palate as in electropalatography: which of 62 electrodes are in contact over time.

An electrode is on where the tongue's surface under it presses on the palate, or, where the scenario gives the plate a thickness,
is within it. Nodes stand further apart than electrodes, so what they know is interpolated on the faces between them: the
pressure, and how far the surface is from the palate.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from explicitfe.fem.mesh.hexmesh import FACES, free_faces
from explicitfe.fem.mesh.surface_points import surface_areas
from explicitfe.fem.mesh.triangles import corners_of
from explicitfe.results.files import Recorded
from explicitfe.results.measure.bodies import value_of_palate
from explicitfe.results.measure.document import ContactCourse, Palatogram, PalatogramPattern
from explicitfe.results.measure.electrodes import ELECTRODE_COLUMNS, ELECTRODE_ROWS, Electrodes, electrodes
from explicitfe.results.measure.sections import middle
from explicitfe.results.measure.tract import PALATE, TOUCHING_GAP_M, palate_midline

# The surface of the tongue under an electrode is looked for within this distance, along the palate's normal.
SURFACE_WITHIN_M = 5e-3
# A point this far outside of a triangle, as a share of it, is still in it: neighbours leave no gap between them.
TRIANGLE_EDGE_SHARE = 1e-9
# Weights of the indices of Recasens and Pallares (2001): one more electrode counts for more than all those of lesser weight.
ANTERIORITY_WEIGHTS = np.array([4921.0, 729.0, 81.0, 9.0, 1.0])
CENTRALITY_WEIGHTS = np.array([1.0, 17.0, 289.0, 4913.0])
DORSAL_ROWS = slice(5, 8)
# Weights of the rows in the centre of gravity (Hardcastle, Gibbon and Nicolaidis 1991).
GRAVITY_WEIGHTS = np.arange(ELECTRODE_ROWS, 0, -1) - 0.5

Grid = list[list[Any]]


class ContactSample(NamedTuple):
    """Contact at one time.

    Attributes
    ----------
    on : (62,) whether the electrodes are touched.
    pressure : (62,) Pa. On each; 0 where it is off.
    area_m2, force_N : contact area with the whole palate, and its normal force sum.
    """

    on: np.ndarray
    pressure: np.ndarray
    area_m2: float
    force_N: float


class TongueOnPalate:
    """The surface of the tongue and the electrodes of a result, evaluated at one time after another."""

    def __init__(self, result: Recorded, at: Electrodes) -> None:
        self.result, self.at = result, at
        self.plate_m = length_of_palate(result, "plate_mm") or 0.0
        element, face = free_faces(result.mesh.hexes)
        self._areas = surface_areas(result.mesh)
        self.faces = result.mesh.hexes[element[:, None], FACES[face]]
        # What lies inside the palate at rest does not push there: the run counts its distance from that depth on.
        rotation, shift = result.placement(PALATE, 0)
        self._depth_at_rest = np.zeros(result.mesh.node_count)
        surface = np.unique(self.faces)
        at_rest = (result.mesh.points[surface] - shift) @ rotation
        self._depth_at_rest[surface] = np.maximum(0.0, -at.underside.clearance(at_rest))

    def contact(self, step: int) -> ContactSample:
        """Which electrodes are on at a step.

        From each electrode a line runs along the palate's normal to the nearest face of the tongue that has a pressed node. It is
        on where the pressure interpolated there is above 0 and the distance interpolated there is at most ``TOUCHING_GAP_M``;
        or, of all faces, where that distance is at most the thickness of the plate.
        Faces are interpolated linearly between their corners and their middle, which is the mean of them.
        """
        count = len(self.at.position)
        pressure = np.maximum(self.result.field(f"contact_pressure_{PALATE}", step), 0.0)
        pressed = self.faces[(pressure[self.faces] > 0.0).any(axis=1) | (self.plate_m > 0.0)]
        on, felt = np.zeros(count, dtype=bool), np.zeros(count)
        if not len(pressed):
            return ContactSample(on, felt, 0.0, 0.0)
        rotation, shift = self.result.placement(PALATE, step)
        nodes, corner = np.unique(pressed, return_inverse=True)
        corner = corner.reshape(pressed.shape)
        x = (self.result.mesh.points[nodes] + self.result.displacement(step)[nodes] - shift) @ rotation
        distance = self.at.underside.clearance(x) + self._depth_at_rest[nodes]
        # the run's own surface is smoothed: where it presses, they touch
        distance = np.where(pressure[nodes] > 0.0, np.minimum(distance, 0.0), distance)
        values = np.column_stack([x, distance, pressure[nodes]])[corner]
        middles = np.broadcast_to(values.mean(axis=1, keepdims=True), values.shape)
        triangles = np.stack([values, np.roll(values, -1, axis=1), middles], axis=2).reshape(-1, 3, values.shape[2])
        hit, weights, triangle = _nearest_on_lines(self.at.position, self.at.normal, triangles[:, :, :3])
        at = np.einsum("kc,kcv->kv", weights, triangles[triangle])
        on[hit] = (at[:, 3] <= TOUCHING_GAP_M) & (at[:, 4] > 0.0) | (at[:, 3] <= self.plate_m) & (self.plate_m > 0.0)
        felt[hit] = np.where(on[hit], at[:, 4], 0.0)
        return ContactSample(on, felt, float(self._areas[pressure > 0.0].sum()), float(self._areas @ pressure))


def electrodes_of(result: Recorded) -> Electrodes | None:
    """The electrodes on the bone called "palate"; None without a palate, without its pressure, or if it is too short."""
    if PALATE not in result.bones or f"contact_pressure_{PALATE}" not in result.fields:
        return None
    bone, plane = result.bones[PALATE], middle(result.mesh)
    corners = corners_of(*bone)
    line = palate_midline(corners, plane)
    return None if line is None else electrodes(line, corners, plane, length_of_palate(result, "hard_palate_mm"))


class ContactHistory:
    """Contact at every stored sample up to a step.

    Attributes
    ----------
    at : the electrodes.
    times_s : (t,) of the samples.
    on : (t, 62) whether the electrodes are touched.
    samples : what was felt at each.
    """

    def __init__(self, result: Recorded, step: int, at: Electrodes) -> None:
        tongue = TongueOnPalate(result, at)
        self.at = at
        self.times_s = result.times[: step + 1]
        self.samples = [tongue.contact(number) for number in range(step + 1)]
        self.on = np.array([sample.on for sample in self.samples])

    @property
    def most(self) -> int:
        """The first sample with the largest number of contacts."""
        return int(self.on.sum(axis=1).argmax())

    @property
    def course(self) -> ContactCourse:
        """Number of contacts, contact area and normal force sum over time."""
        return ContactCourse(
            time_ms=(1e3 * self.times_s).tolist(),
            contacts=self.on.sum(axis=1).tolist(),
            area_mm2=[1e6 * sample.area_m2 for sample in self.samples],
            force_N=[sample.force_N for sample in self.samples],
        )

    def pattern(self, step: int) -> PalatogramPattern:
        """The pattern at a step, with its indices."""
        at, on = self.at, self.on[step]
        touched, exists = (np.zeros((ELECTRODE_ROWS, ELECTRODE_COLUMNS), dtype=bool) for _ in range(2))
        touched[at.row, at.column] = on
        exists[at.row, at.column] = True
        return PalatogramPattern(
            time_ms=1e3 * float(self.times_s[step]),
            electrodes=_grid(at, [bool(state) for state in on]),
            contacts=int(on.sum()),
            anteriority=anteriority(touched),
            centrality=centrality(touched),
            dorsopalatal=float(touched[DORSAL_ROWS].mean()),
            centre_of_gravity=centre_of_gravity(touched),
            closed_rows=[int(row) + 1 for row in np.flatnonzero((touched | ~exists).all(axis=1))],
        )


def contact_history(result: Recorded, step: int) -> ContactHistory | None:
    """The contact up to a step; None as for :func:`electrodes_of`."""
    at = electrodes_of(result)
    return None if at is None else ContactHistory(result, step, at)


def palatogram(result: Recorded, step: int) -> Palatogram | None:
    """The palatogram at a step, and its course up to there; None as for :func:`electrodes_of`."""
    history = contact_history(result, step)
    if history is None:
        return None
    at, on, times_ms = history.at, history.on, 1e3 * history.times_s
    first_ms = [float(times_ms[column.argmax()]) if column.any() else None for column in on.T]
    return Palatogram(
        now=history.pattern(step),
        most=history.pattern(history.most),
        pressure_kPa=_grid(at, (1e-3 * history.samples[step].pressure).tolist()),
        first_contact_ms=_grid(at, first_ms),
        duration_ms=_grid(at, _durations(times_ms, on).tolist()),
        row_places_mm=(1e3 * at.row_places).tolist(),
        course=history.course,
    )


def anteriority(touched: np.ndarray) -> float:
    """How far in front the contact of rows 1 to 5 reaches, 0 to 1: Recasens and Pallares (2001), J. Phonetics 29:283.

    ``touched`` (8, 8), in which the first and the last of the first row are False.
    """
    rows = touched[: len(ANTERIORITY_WEIGHTS)].sum(axis=1) / np.array([6.0, 8.0, 8.0, 8.0, 8.0])
    return float(np.log1p(ANTERIORITY_WEIGHTS @ rows) / np.log1p(ANTERIORITY_WEIGHTS.sum()))


def centrality(touched: np.ndarray) -> float:
    """How near to the midline the contact reaches, 0 to 1: Recasens and Pallares (2001), J. Phonetics 29:283."""
    columns = touched.sum(axis=0)
    half = ELECTRODE_COLUMNS // 2
    pairs = (columns[:half] + columns[: half - 1 : -1]) / np.array([14.0, 16.0, 16.0, 16.0])
    return float(np.log1p(CENTRALITY_WEIGHTS @ pairs) / np.log1p(CENTRALITY_WEIGHTS.sum()))


def centre_of_gravity(touched: np.ndarray) -> float | None:
    """Mean row of the contact, 0.5 for the last to 7.5 for the first; None without contact.

    Hardcastle, Gibbon and Nicolaidis (1991), J. Phonetics 19:251.
    """
    rows = touched.sum(axis=1)
    return float(GRAVITY_WEIGHTS @ rows / rows.sum()) if rows.any() else None


def length_of_palate(result: Recorded, key: str) -> float | None:
    """A length in the ``[[bone]]`` table of the palate in the scenario of a result, m; None if it is not given."""
    length_mm = value_of_palate(result, key)
    return None if length_mm is None else 1e-3 * float(length_mm)


def _durations(times: np.ndarray, on: np.ndarray) -> np.ndarray:
    """How long each electrode is on, (62,): a sample (t,) stands for half the time to each of its neighbours."""
    apart = np.diff(times)[:, None]
    return (0.5 * apart * (on[1:].astype(float) + on[:-1])).sum(axis=0)


def _grid(at: Electrodes, values: list[Any]) -> Grid:
    """Values of the electrodes in their eight rows of eight; None where there is none."""
    grid: Grid = [[None] * ELECTRODE_COLUMNS for _ in range(ELECTRODE_ROWS)]
    for row, column, value in zip(at.row, at.column, values, strict=True):
        grid[row][column] = value
    return grid


def _nearest_on_lines(
    points: np.ndarray, directions: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where lines meet triangles (m, 3 corners, 3) nearest to their points (k, 3) m, within ``SURFACE_WITHIN_M``.

    By the method of Moeller and Trumbore (1997); ``directions`` (k, 3) have unit length. Returns which lines do (k,), and of
    those the weights (h, 3) of the corners and the triangle (h,).
    """
    a, b, c = np.moveaxis(triangles, 1, 0)
    first, second = b - a, c - a
    across = np.cross(directions[:, None], second)
    whole = np.einsum("mi,kmi->km", first, across)
    offset = points[:, None] - a
    beside = np.cross(offset, first)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("kmi,kmi->km", offset, across) / whole
        v = np.einsum("ki,kmi->km", directions, beside) / whole
        along = np.einsum("mi,kmi->km", second, beside) / whole
        inside = (np.minimum(np.minimum(u, v), 1.0 - u - v) >= -TRIANGLE_EDGE_SHARE) & (np.abs(along) <= SURFACE_WITHIN_M)
    far = np.where(inside, np.abs(along), np.inf)
    nearest = far.argmin(axis=1)
    hit = np.isfinite(far.min(axis=1))
    line = np.flatnonzero(hit)
    u, v = u[line, nearest[hit]], v[line, nearest[hit]]
    return hit, np.column_stack([1.0 - u - v, u, v]), nearest[hit]
