"""The leak: the widest way for air between tongue and roof of the mouth, from behind the incisors to the pharynx.

The roof is the underside of the bone "palate", and of a deformable velum. A grid on it reaches on both sides to the crest of the
dental arch, or to the edge of the roof where there is no arch, and behind the hard palate to the height of the gum. What lies
outside of that border or below it counts as closed: lips, cheeks and the pillars of the fauces are soft tissue that the model
lacks. The gap at a point of the grid is therefore the distance to the nearest point of the tongue's surface, 0 inside the
tongue, and at most the distance to the border.

The width of the leak is the largest gap that a way from the first row of the grid to the last one keeps everywhere. Its area is
that of the smallest open cross-section between them: the integral of the gap along the curve from the left border of the roof to
the right one for which it is smallest. Both are found in the graph of the grid, with steps to the eight neighbours, so a curve
that runs obliquely is up to 8 % too long on square cells. A gap of at most ``TOUCHING_GAP_M`` counts as closed in the area, which
is therefore 0 if and only if the width is at most that. The walls of a slit are near too: between walls w apart the gap is at
most w / 2, and a slit of width w and height h < w / 2 has the area w h - h^2.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy
from scipy.sparse import csgraph

from explicitfe.fem.mesh.triangles import surface_triangles
from explicitfe.platform.host.kept import kept
from explicitfe.results.files import Recorded
from explicitfe.results.measure.bodies import roof_of, tongue_of
from explicitfe.results.measure.document import Closure, LeakCourse, LeakFigures
from explicitfe.results.measure.electrodes import HARD_PALATE_M
from explicitfe.results.measure.palatogram import length_of_palate
from explicitfe.results.measure.roof_grid import OnTriangles, RoofGrid, clearance, roof_grid, surface_samples
from explicitfe.results.measure.sections import middle
from explicitfe.results.measure.tract import PALATE, TOUCHING_GAP_M

# The distance from the tongue is that from the triangles of so many samples of its surface: for the built-in tongue on the medium
# mesh right within 2 micrometres.
SAMPLES_TRIED = 4
WIDER_SHARE = 1e-6  # of the wider end of a step
LEAST_WEIGHT_M = 1e-9  # a weight of 0 would be no edge
EXCLUDED_M = -1.0  # gap of a point that a way may not use


class Leak(NamedTuple):
    """The leak at one time.

    Attributes
    ----------
    width_m, area_m2 : width of the widest way, and area of the smallest cross-section.
    path : (k, 3) m. The widest way on the roof, from front to back.
    narrowest : number of the point of the path with the smallest gap.
    place_m, side_m : of that point, along the midline from the edge of the incisors, and to the right of the midsagittal plane.
    over_plate_m, beside_molars_m : width of the widest way inside of the edge of the gum, and outside, to the end of the hard
        palate; a way beside the molars leads nowhere where the tongue touches the gum as far as that.
    """

    width_m: float
    area_m2: float
    path: np.ndarray
    narrowest: int
    place_m: float
    side_m: float
    over_plate_m: float
    beside_molars_m: float

    @property
    def closed(self) -> bool:
        """Whether nothing gets through."""
        return self.width_m <= TOUCHING_GAP_M


class Way(NamedTuple):
    """The widest way: its width ``width_m``, the area ``area_m2`` of the smallest cross-section, its points ``path`` (k, 3) m."""

    width_m: float
    area_m2: float
    path: np.ndarray


class LeakHistory:
    """The leak at stored samples up to a step, whose ``times_s`` are (t,); one sample takes about 20 ms."""

    def __init__(self, result: Recorded, step: int, grid: RoofGrid) -> None:
        self._result, self._grid = result, grid
        mesh, _ = tongue_of(result, 0)
        self._samples = surface_samples(surface_triangles(mesh, mesh.points)[0])
        self.times_s = result.times[: step + 1]

    def at(self, step: int) -> Leak:
        """The leak at a step."""
        points, tongue = self._surfaces(step)
        return leak_in(self._grid, points, gaps_below(points, tongue, self._samples, self._grid.to_border))

    def widest(self, step: int) -> Way:
        """The widest way at a step."""
        return _way(*self._surfaces(step), self._samples, self._grid.to_border)

    @property
    def width_m(self) -> np.ndarray:
        """Widths (t,) m."""
        return self._sizes[:, 0]

    @property
    def area_m2(self) -> np.ndarray:
        """Areas (t,) m2."""
        return self._sizes[:, 1]

    @cached_property
    def _sizes(self) -> np.ndarray:
        return np.array([self.widest(step)[:2] for step in range(len(self.times_s))])

    def _surfaces(self, step: int) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, 3) m of the grid, and triangles (m, 3 corners, 3) m of the tongue."""
        mesh, displacement = tongue_of(self._result, step)
        roof = roof_of(self._result, step, self._result.placed_bones(step)[PALATE])
        return self._grid.points.at(roof), surface_triangles(mesh, mesh.points + displacement)[0]


def leak_history(result: Recorded, step: int) -> LeakHistory | None:
    """The leak up to a step; None without a bone called "palate", or where that has no underside on both sides of the midline."""
    if PALATE not in result.bones:
        return None
    length_m = length_of_palate(result, "hard_palate_mm") or HARD_PALATE_M
    grid = roof_grid(roof_of(result, 0, result.bones[PALATE]), middle(tongue_of(result, 0)[0]), length_m)
    return None if grid is None else LeakHistory(result, step, grid)


def leak(result: Recorded, step: int) -> LeakFigures | None:
    """The leak at a step, and its course up to there; None as for :func:`leak_history`."""
    history = leak_history(result, step)
    if history is None:
        return None
    now = history.at(step)
    return LeakFigures(
        width_mm=1e3 * now.width_m,
        area_mm2=1e6 * now.area_m2,
        closed=now.closed,
        place_mm=1e3 * now.place_m,
        side_mm=1e3 * now.side_m,
        over_plate_mm=1e3 * now.over_plate_m,
        beside_molars_mm=1e3 * now.beside_molars_m,
        course=LeakCourse(
            time_ms=(1e3 * history.times_s).tolist(),
            width_mm=(1e3 * history.width_m).tolist(),
            area_mm2=(1e6 * history.area_m2).tolist(),
        ),
        closures=[
            Closure(from_ms=1e3 * start, to_ms=1e3 * end, duration_ms=1e3 * (end - start))
            for start, end in times_below(history.times_s, history.width_m, TOUCHING_GAP_M)
        ],
    )


def leak_in(grid: RoofGrid, points: np.ndarray, gaps: np.ndarray) -> Leak:
    """The leak between points (n, 3) m of a grid and a tongue in signed gaps (n,) m from them."""
    width, path = widest_path(gaps, grid.side.shape)
    narrowest = int(gaps[path].argmin())
    row, column = divmod(int(path[narrowest]), grid.side.shape[1])
    over, beside = (
        widest_path(np.where(region, gaps.reshape(region.shape), EXCLUDED_M)[:rows].ravel(), region[:rows].shape)[0]
        for region, rows in ((grid.over_plate, None), (grid.beside_molars, grid.hard_rows))
    )
    area = smallest_area(gaps, points, grid.side.shape)
    return Leak(width, area, points[path], narrowest, float(grid.place[row]), float(grid.side[row, column]), over, beside)


def gaps_below(points: np.ndarray, tongue: np.ndarray, samples: OnTriangles, to_border: np.ndarray) -> np.ndarray:
    """Gaps (n,) m at points (n, 3) m of a grid, negative inside of the tongue (m, 3 corners, 3) m."""
    distance, _ = clearance(points, tongue, samples, SAMPLES_TRIED)
    return np.minimum(distance, to_border.ravel())


@kept(1024)  # a report measures the same samples several times
def _way(points: np.ndarray, tongue: np.ndarray, samples: OnTriangles, to_border: np.ndarray) -> Way:
    gaps = gaps_below(points, tongue, samples, to_border)
    width, path = widest_path(gaps, to_border.shape)
    return Way(width, smallest_area(gaps, points, to_border.shape), points[path])


def widest_path(gaps: np.ndarray, shape: tuple[int, ...]) -> tuple[float, np.ndarray]:
    """Width m of the widest way from the first row of a grid to the last one, and the numbers (k,) of its points.

    No way has a larger smallest gap than that on the maximum spanning tree of the grid. Signed ``gaps`` (n,) m let it pass a
    closure where the overlap is least; its width is then 0.
    """
    first, second, _, _ = _steps(shape)
    count, columns = len(gaps), shape[1]
    front, back = np.arange(columns), np.arange(count - columns, count)
    one = np.concatenate([first, np.full(columns, count), back])
    other = np.concatenate([second, front, np.full(columns, count + 1)])
    # All steps to a narrow point are as wide as that: of these the one from the wider point comes first.
    ends = np.sort(np.stack([gaps[first], gaps[second]]), axis=0)
    width = np.concatenate([ends[0] + WIDER_SHARE * ends[1], gaps[front], gaps[back]])
    weight = width.max() - width + LEAST_WEIGHT_M
    tree = csgraph.minimum_spanning_tree(scipy.sparse.csr_array((weight, (one, other)), shape=(count + 2, count + 2)))
    before = csgraph.breadth_first_order(tree, count, directed=False)[1]
    numbers, point = [], int(before[count + 1])
    while point != count:
        numbers.append(point)
        point = int(before[point])
    path = np.array(numbers[::-1])
    return max(0.0, float(gaps[path].min())), path


def smallest_area(gaps: np.ndarray, points: np.ndarray, shape: tuple[int, ...]) -> float:
    """The smallest integral of the gap, m2, along a curve from the left border of a grid (n, 3) m to the right one."""
    free = np.where(gaps > TOUCHING_GAP_M, gaps, 0.0)
    first, second, one, other = _steps(shape)
    # Simpson's rule; the gap in the middle of a diagonal is the mean of the four corners of its cell.
    gap = (2.0 * (free[first] + free[second]) + free[one] + free[other]) / 6.0
    weight = np.linalg.norm(points[first] - points[second], axis=1) * gap
    number = np.arange(len(gaps)).reshape(shape)
    graph = scipy.sparse.csr_array((weight, (first, second)), shape=(len(gaps), len(gaps)))
    area = csgraph.dijkstra(graph, directed=False, indices=number[:, 0], min_only=True)[number[:, -1]].min()
    return float(area)


@kept(4)
def _steps(shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Steps from each point of a grid to its neighbours: both ends, and the two other corners of the cell of a diagonal."""
    n = np.arange(shape[0] * shape[1]).reshape(shape)
    a, b, c, d = n[:-1, :-1], n[:-1, 1:], n[1:, :-1], n[1:, 1:]
    steps = [(n[:-1], n[1:], n[:-1], n[1:]), (n[:, :-1], n[:, 1:], n[:, :-1], n[:, 1:]), (a, d, b, c), (b, c, a, d)]
    first, second, one, other = (np.concatenate([part.ravel() for part in parts]) for parts in zip(*steps, strict=True))
    return first, second, one, other


def times_below(times: np.ndarray, values: np.ndarray, limit: float) -> list[tuple[float, float]]:
    """Start and end of each time in which values (t,) are at most the limit, linear between ``times`` (t,)."""
    below = np.concatenate([[False], values <= limit, [False]])
    starts = np.flatnonzero(below[1:] & ~below[:-1]).tolist()
    ends = (np.flatnonzero(below[:-1] & ~below[1:]) - 1).tolist()

    def crossing(outer: int, inner: int) -> float:
        if not 0 <= outer < len(times):
            return float(times[inner])
        share = (limit - values[inner]) / (values[outer] - values[inner])
        return float(times[inner] + share * (times[outer] - times[inner]))

    return [(crossing(start - 1, start), crossing(end + 1, end)) for start, end in zip(starts, ends, strict=True)]
