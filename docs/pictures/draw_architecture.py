"""Draw the structure of the package from its imports: rooms on floors, and arrows from each room to those that it imports.

    python docs/pictures/draw_architecture.py [PICTURE.png]

A room is a folder of the package. A floor holds the rooms that import only from floors below. Nothing is imported here: the
sources are read with ``ast``. Arrows that follow from others (a longer path leads there too) are counted, but not drawn. The
numbers of rooms, arrows, floors and circles are printed.
"""

from __future__ import annotations

import ast
import sys
import textwrap
from graphlib import CycleError, TopologicalSorter
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
PACKAGE = HERE.parent.parent / "explicitfe"

# What a newcomer should know of each room; a room without a sentence is an error.
ROOMS = {
    "compiled": "machine code: compile options, vectors, arrays, threads; no mechanics",
    "host": "the operating system: signals, files, memory",
    "acoustics": "sound in tubes: losses, formants; no geometry",
    "mesh": "meshes of 8-node hexahedra: making, ordering, quality",
    "bones": "rigid surfaces: triangles, signed distance, motion",
    "materials": "laws: one file a law",
    "elements": "elements and how they resist hourglassing",
    "effects": "what an elastic model lacks: one file an effect",
    "forces": "forces on the nodes: one file a force",
    "scenario": "the text of a scenario, read and checked",
    "results": "result files and typed reports: written, read",
    "measure": "what a tongue did: shape, speeds, contact, airway, formants",
    "model": "physics made from a scenario: tongue, specimen, own mesh",
    "view": "pictures, terminal tables, the HTML report",
    "solve": "steps in time, equilibria, single points",
    "measured": "datasets: read, checked, in SI units",
    "run": "commands on a scenario: run, check, bench",
    "predict": "the answer of a tissue in a measured test",
    "identify": "the constants that fit a dataset",
    "close_loop": "which effect a dataset shows that the model lacks",
    "blind": "how often close-loop is right: sealed cases",
}
# Above all rooms: what a person or a program enters by.
TOP = ("__init__", "__main__", "cli")
BASE = "errors"  # imported by nearly all; not drawn

WIDTH, HEIGHT, GAP, RISE = 2.75, 1.0, 0.3, 1.65  # of a box, between boxes, from floor to floor
LANE = 0.1  # width of an arrow that passes a floor
MECHANICS, TEXT, STUDY, DRAWN = "#dbe7f3", "#fbeed3", "#e3efdc", "#f5dfdc"
SUBJECTS = dict.fromkeys(ROOMS, MECHANICS)
SUBJECTS |= dict.fromkeys(("scenario", "model", "run", "host"), TEXT)
SUBJECTS |= dict.fromkeys(("measured", "predict", "identify", "close_loop", "blind"), STUDY)
SUBJECTS |= dict.fromkeys(("results", "measure", "view", "acoustics"), DRAWN)
LINE = "#5a6570"
LEGEND = """An arrow means: imports from. Arrows that follow from longer paths are left out. errors.py stands below all rooms.
Blue: mechanics. Yellow: from the text of a scenario to its result. Green: measured data. Red: results, measures, sound."""

Place = str | tuple[str, int]  # a room, or the bend of the arrows to a room where they pass a floor


def room_of(path: Path) -> str:
    """The room of a module, or its own name where it stands at the top of the package."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return parts[0]


def imported_rooms(path: Path) -> set[str]:
    """Rooms that a module imports from, also inside functions."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {name.split(".")[1] for name in names if name.startswith("explicitfe.")}


def read_graph() -> dict[str, set[str]]:
    """Room -> the rooms that it imports from."""
    modules = sorted(PACKAGE.rglob("*.py"))
    rooms = {room_of(path) for path in modules if path.parent != PACKAGE} - set(TOP)
    graph: dict[str, set[str]] = {room: set() for room in sorted(rooms)}
    for path in modules:
        if room_of(path) in rooms:
            graph[room_of(path)] |= (imported_rooms(path) & rooms) - {room_of(path)}
    return graph


def floors_of(graph: dict[str, set[str]]) -> dict[str, int]:
    """The floor of each room: one above the highest room that it imports from."""
    floors: dict[str, int] = {}
    for room in TopologicalSorter(graph).static_order():
        floors[room] = 1 + max((floors[other] for other in graph[room]), default=-1)
    return floors


def reachable(graph: dict[str, set[str]], room: str) -> set[str]:
    """All rooms below a room."""
    return graph[room].union(*(reachable(graph, other) for other in graph[room]))


def drawn_arrows(graph: dict[str, set[str]]) -> list[tuple[str, str]]:
    """The arrows that do not follow from others."""
    return [
        (room, other)
        for room, others in graph.items()
        for other in sorted(others)
        if not any(other in reachable(graph, between) for between in others - {other})
    ]


def width_of(place: Place) -> float:
    """Of a box, or of the lane of an arrow."""
    return WIDTH if isinstance(place, str) else LANE


class Layout:
    """Places of the rooms, and of the bends of arrows that pass a floor on their way down, so that none passes behind a box.

    Attributes
    ----------
    rows : what stands on each floor, from left to right: rooms, and bends (arrow's number, floor).
    x : the middle of each.
    """

    def __init__(self, floors: dict[str, int], arrows: list[tuple[str, str]]) -> None:
        self.rows: list[list[Place]] = [[] for _ in range(max(floors.values()) + 1)]
        for room in ROOMS:
            self.rows[floors[room]].append(room)
        self.paths: list[list[Place]] = []
        lanes: dict[tuple[str, int], Place] = {}
        for a, b in arrows:
            bends: list[Place] = []
            for floor in range(floors[a] - 1, floors[b], -1):
                # arrows to the same room share their way down
                if (b, floor) not in lanes:
                    lanes[b, floor] = (b, floor)
                    self.rows[floor].append((b, floor))
                bends.append((b, floor))
            self.paths.append([a, *bends, b])
        self.links = sorted({link for path in self.paths for link in pairwise(path)}, key=str)
        self.x = self._best()

    def _packed(self) -> dict[Place, float]:
        x: dict[Place, float] = {}
        for row in self.rows:
            at = -0.5 * (sum(map(width_of, row)) + GAP * (len(row) - 1))
            for place in row:
                x[place] = at + 0.5 * width_of(place)
                at += width_of(place) + GAP
        return x

    def _cost(self, x: dict[Place, float]) -> float:
        crossings = sum(
            (x[a] - x[c]) * (x[b] - x[d]) < 0.0
            for k, (a, b) in enumerate(self.links)
            for c, d in self.links[:k]
            if self._floor(a) == self._floor(c)
        )
        return 3.0 * crossings + sum(abs(x[a] - x[b]) for a, b in self.links)

    def _floor(self, place: Place) -> int:
        return next(k for k, row in enumerate(self.rows) if place in row)

    def _best(self) -> dict[Place, float]:
        """The order along each floor with few crossings and short arrows: neighbours are swapped as long as that helps."""
        x = self._packed()
        cost, better = self._cost(x), True
        while better:
            better = False
            for row in self.rows:
                for i, j in combinations(range(len(row)), 2):
                    row[i], row[j] = row[j], row[i]
                    trial = self._packed()
                    if self._cost(trial) < cost - 1e-9:
                        cost, x, better = self._cost(trial), trial, True
                    else:
                        row[i], row[j] = row[j], row[i]
        for _ in range(60):  # shift whole floors, then single places as far as their neighbours allow
            for row in self.rows:
                for k, place in enumerate(row):
                    others = [b if a == place else a for a, b in self.links if place in (a, b)]
                    aim = sum(x[other] for other in others) / max(len(others), 1)
                    low, high = -np.inf, np.inf
                    if k > 0:
                        low = x[row[k - 1]] + 0.5 * (width_of(row[k - 1]) + width_of(place)) + GAP
                    if k + 1 < len(row):
                        high = x[row[k + 1]] - 0.5 * (width_of(row[k + 1]) + width_of(place)) - GAP
                    x[place] = min(max(aim, low), high)
        return x


def draw(graph: dict[str, set[str]], path: Path) -> None:
    """Write the picture."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import FancyBboxPatch

    floors = floors_of(graph)
    layout = Layout(floors, drawn_arrows(graph))
    x = layout.x
    top = RISE * len(layout.rows) - 0.4
    left = min(x[place] - 0.5 * width_of(place) for place in x) - GAP
    right = max(x[place] + 0.5 * width_of(place) for place in x) + GAP
    figure = Figure(figsize=(right - left, top + 1.9), dpi=100)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(left, right), ylim=(-0.85, top + 1.05))
    axes.set_axis_off()

    def box(centre: float, bottom: float, width: float, height: float, title: str, words: str, colour: str) -> None:
        style = "round,pad=0,rounding_size=0.08"
        corner = centre - 0.5 * width, bottom
        axes.add_patch(FancyBboxPatch(corner, width, height, boxstyle=style, fc=colour, ec=LINE, lw=1.0, zorder=3))
        axes.text(centre, bottom + height - 0.10, title, ha="center", va="top", fontsize=14, weight="bold", zorder=4)
        wrapped = "\n".join(textwrap.wrap(words, int(10.0 * width)))
        axes.text(centre, bottom + height - 0.42, wrapped, ha="center", va="top", fontsize=10.5, zorder=4, linespacing=1.15)

    # where an arrow leaves and reaches a box: spread over its edge, in the order of where the arrows go
    leaving = {
        room: sorted({p[1] for p in layout.paths if p[0] == room}, key=lambda place: (x[place], str(place))) for room in graph
    }
    arriving = {
        room: sorted({p[-2] for p in layout.paths if p[-1] == room}, key=lambda place: (x[place], str(place))) for room in graph
    }

    def spread(centre: float, places: list[Place], place: Place) -> float:
        return centre + 0.55 * WIDTH * ((places.index(place) + 1.0) / (len(places) + 1.0) - 0.5)

    for bends in layout.paths:
        a, b = bends[0], bends[-1]
        assert isinstance(a, str) and isinstance(b, str)
        points = [(spread(x[a], leaving[a], bends[1]), RISE * floors[a])]
        for place in bends[1:-1]:
            assert isinstance(place, tuple)
            points += [(x[place], RISE * place[1] + HEIGHT), (x[place], RISE * place[1])]
        points.append((spread(x[b], arriving[b], bends[-2]), RISE * floors[b] + HEIGHT))
        axes.plot(*zip(*points[:-1], strict=True), color=LINE, lw=1.2, solid_joinstyle="round", zorder=2)
        axes.annotate(
            "",
            points[-1],
            points[-2],
            arrowprops={
                "arrowstyle": "-|>,head_length=0.55,head_width=0.22",
                "color": LINE,
                "lw": 1.2,
                "shrinkA": 0,
                "shrinkB": 0,
            },
            zorder=2,
        )
    for room in graph:
        box(x[room], RISE * floors[room], WIDTH, HEIGHT, room, ROOMS[room], SUBJECTS[room])
    words = "the command line, `python -m explicitfe` and `import explicitfe` may use every room"
    middle = 0.5 * (left + right)
    box(middle, top + 0.15, right - left - 2.0 * GAP, 0.75, "cli    __main__    __init__", words, "#f2f2f2")
    axes.text(middle, -0.2, LEGEND, ha="center", va="top", fontsize=11, color=LINE, linespacing=1.4)
    figure.savefig(path)


def main() -> None:
    graph = read_graph()
    unknown = set(graph) ^ set(ROOMS)
    if unknown:
        sys.exit(f"ROOMS has to name exactly the rooms of the package; these differ: {', '.join(sorted(unknown))}")
    try:
        floors = floors_of(graph)
    except CycleError as error:
        sys.exit(f"imports in a circle: {' -> '.join(error.args[1])}")
    total = sum(len(others) for others in graph.values())
    print(f"{len(graph)} rooms, {total} arrows between rooms ({len(drawn_arrows(graph))} drawn), ", end="")
    print(f"{max(floors.values()) + 1} floors, 0 circles")
    for floor in range(max(floors.values()), -1, -1):
        print(f"  {floor:2d}  {', '.join(room for room in ROOMS if floors[room] == floor)}")
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "architecture.png"
    draw(graph, path)


if __name__ == "__main__":
    main()
