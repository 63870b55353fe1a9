"""Draw the wings of the package, and the folders of each wing, on levels with arrows for imports.

    python docs/pictures/draw_architecture.py [FOLDER]

A box is one level above the highest box that it imports from. The sources are read with ``ast``, not imported. The picture of the
wings has all arrows between them; those of each wing omit arrows that follow from a longer path. The numbers of boxes, arrows,
levels and cycles are printed.
"""

from __future__ import annotations

import ast
import sys
import textwrap
from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
PACKAGE = HERE.parent.parent / "explicitfe"

# Wing -> its description, colour, and the descriptions of its folders; the script fails if one is missing.
WINGS: dict[str, tuple[str, str, dict[str, str]]] = {
    "platform": ("compiled kernels, operating system, errors", "#eeeeee", {
        "errors": "errors and progress",
        "compiled": "compiler options, vectors, arrays, threads",
        "host": "files, signals, memory, worker processes",
    }),
    "fem": ("finite elements: a library of its own", "#dbe7f3", {
        "mesh": "hexahedral meshes: generation, order, quality",
        "bones": "rigid surfaces: signed distance, motion",
        "materials": "material laws: one file per law",
        "elements": "elements and hourglass control",
        "effects": "what an elastic law lacks: one file per effect",
        "inputs": "checked numbers and tables, extensions",
        "forces": "nodal forces: one file per force",
        "model": "the model: mesh, law, supports, loads",
        "solve": "time integration, equilibria, points, sections",
    }),
    "results": ("result files, measures, sound, documents", "#f5dfdc", {
        "documents": "typed answers of commands",
        "files": "result files: writing and reading",
        "measure": "shape, speed, contact, airway, formants",
        "acoustics": "sound in tubes",
    }),
    "simulate": ("scenarios, anatomy, runs, sweeps", "#fbeed3", {
        "scenario": "scenario files: tables and reading",
        "anatomy": "tongue, specimen, own mesh, surgery",
        "run": "run, check and resume a scenario",
        "sweep": "parameter sweeps: designs, workers, tables",
    }),
    "inverse": ("measured data, constants, missing effects", "#e3efdc", {
        "measured": "datasets: reading, validation, SI units",
        "predict": "response of a tissue in a measured test",
        "identify": "constants that fit a dataset",
        "close_loop": "effects that data show and the model lacks",
    }),
    "app": ("command line, Python functions, pictures, pages", "#ece3f2", {
        "view": "pictures, terminal tables, pages",
        "api": "Python functions of the commands",
        "tools": "doctor, lists, new scenario, speed",
        "verify": "validation claims and their references",
        "cli": "the command line",
    }),
}  # fmt: skip
WIDTH, HEIGHT, GAP, RISE = 2.75, 1.0, 0.3, 1.65  # of a box, between boxes, from level to level
LANE = 0.1  # width of an arrow that passes a level
LINE = "#5a6570"
Place = str | tuple[str, int]  # a folder, or the bend of the arrows to a folder where they pass a level


def imports_of(path: Path) -> set[tuple[str, ...]]:
    """Parts of the names in the package that a module imports, also inside functions."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {tuple(name.split(".")[1:]) for name in names if name.startswith("explicitfe.")}


def read_graph(wing: str | None = None) -> dict[str, set[str]]:
    """Imports between wings; or, for one wing, imports between its folders."""
    depth = 0 if wing is None else 1
    graph: dict[str, set[str]] = {name: set() for name in (WINGS if wing is None else WINGS[wing][2])}
    for path in sorted(PACKAGE.rglob("*.py")):
        own = path.relative_to(PACKAGE).with_suffix("").parts
        if len(own) < 2 or (wing is not None and own[0] != wing) or own[depth] == "__init__":
            continue
        if own[depth] not in graph:
            sys.exit(f"{'/'.join(own[: depth + 1])} has no description in {Path(__file__).name}")
        targets = {parts[depth] for parts in imports_of(path) if len(parts) > depth and (wing is None or parts[0] == wing)}
        graph[own[depth]] |= (targets & graph.keys()) - {own[depth]}
    return graph


def floors_of(graph: dict[str, set[str]]) -> dict[str, int]:
    """The level of each folder: one above the highest folder that it imports from."""
    levels: dict[str, int] = {}
    for folder in TopologicalSorter(graph).static_order():
        levels[folder] = 1 + max((levels[other] for other in graph[folder]), default=-1)
    return levels


def reachable(graph: dict[str, set[str]], folder: str) -> set[str]:
    """All folders below a folder."""
    return graph[folder].union(*(reachable(graph, other) for other in graph[folder]))


def drawn_arrows(graph: dict[str, set[str]]) -> list[tuple[str, str]]:
    """Imports that do not follow from longer paths."""
    return [
        (folder, other)
        for folder, others in graph.items()
        for other in sorted(others)
        if not any(other in reachable(graph, between) for between in others - {other})
    ]


def width_of(place: Place) -> float:
    """Width of a box, or of the lane of an arrow."""
    return WIDTH if isinstance(place, str) else LANE


class Layout:
    """Positions of the folders, and of the bends of arrows that pass a level, so that no arrow passes behind a box.

    Attributes
    ----------
    rows : what stands on each level, from left to right: folders, and bends (arrow's number, level).
    x : the middle of each.
    """

    def __init__(self, levels: dict[str, int], arrows: list[tuple[str, str]]) -> None:
        self.rows: list[list[Place]] = [[] for _ in range(max(levels.values()) + 1)]
        for folder in levels:
            self.rows[levels[folder]].append(folder)
        self.paths: list[list[Place]] = []
        lanes: dict[tuple[str, int], Place] = {}
        for a, b in arrows:
            bends: list[Place] = []
            for level in range(levels[a] - 1, levels[b], -1):
                # arrows to the same folder share their way down
                if (b, level) not in lanes:
                    lanes[b, level] = (b, level)
                    self.rows[level].append((b, level))
                bends.append((b, level))
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
        """Order the folders of each level for few crossings and short arrows, by swapping neighbours."""
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
        for _ in range(60):  # shift whole levels, then single places as far as their neighbours allow
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


def draw(
    graph: dict[str, set[str]], arrows: list[tuple[str, str]], words: Mapping[str, str], colours: Mapping[str, str], path: Path
) -> None:
    """Draw a picture and write it to a file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import FancyBboxPatch

    levels = floors_of(graph)
    layout = Layout(levels, arrows)
    x = layout.x
    top = RISE * len(layout.rows) - 0.4
    left = min(x[place] - 0.5 * width_of(place) for place in x) - GAP
    right = max(x[place] + 0.5 * width_of(place) for place in x) + GAP
    figure = Figure(figsize=(right - left, top + 0.5), dpi=100)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(left, right), ylim=(-0.25, top + 0.25))
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
        folder: sorted({p[1] for p in layout.paths if p[0] == folder}, key=lambda place: (x[place], str(place)))
        for folder in graph
    }
    arriving = {
        folder: sorted({p[-2] for p in layout.paths if p[-1] == folder}, key=lambda place: (x[place], str(place)))
        for folder in graph
    }

    def spread(centre: float, places: list[Place], place: Place) -> float:
        return centre + 0.55 * WIDTH * ((places.index(place) + 1.0) / (len(places) + 1.0) - 0.5)

    for bends in layout.paths:
        a, b = bends[0], bends[-1]
        assert isinstance(a, str) and isinstance(b, str)
        points = [(spread(x[a], leaving[a], bends[1]), RISE * levels[a])]
        for place in bends[1:-1]:
            assert isinstance(place, tuple)
            points += [(x[place], RISE * place[1] + HEIGHT), (x[place], RISE * place[1])]
        points.append((spread(x[b], arriving[b], bends[-2]), RISE * levels[b] + HEIGHT))
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
    for folder in graph:
        box(x[folder], RISE * levels[folder], WIDTH, HEIGHT, folder, words[folder], colours[folder])
    figure.savefig(path)


def main() -> None:
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE
    for wing in (None, *WINGS):
        graph = read_graph(wing)
        try:
            levels = floors_of(graph)
        except CycleError as error:
            sys.exit(f"cyclic imports: {' -> '.join(error.args[1])}")
        count = sum(len(others) for others in graph.values())
        print(f"{wing or 'wings'}: {len(graph)} boxes, {count} arrows, {max(levels.values()) + 1} levels, 0 cycles")
        if wing is None:
            arrows = [(name, other) for name, others in graph.items() for other in sorted(others)]
            words, colours = ({name: entry[k] for name, entry in WINGS.items()} for k in (0, 1))
        else:
            arrows, words = drawn_arrows(graph), WINGS[wing][2]
            colours = dict.fromkeys(graph, WINGS[wing][1])
        draw(graph, arrows, words, colours, target / f"architecture{'' if wing is None else f'-{wing}'}.png")


if __name__ == "__main__":
    main()
