"""Draw the folders of the package on levels, with arrows for imports.

    python docs/pictures/draw_architecture.py [PICTURE.png]

A folder is one level above the highest folder that it imports from. The sources are read with ``ast``, not imported. Arrows that
follow from a longer path are counted, but not drawn. The numbers of folders, imports, levels and cycles are printed.
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

# Description of each folder; the script fails if a folder has none.
FOLDERS = {
    "compiled": "compiler options, vectors, arrays, threads; no mechanics",
    "host": "operating system: signals, files, memory",
    "acoustics": "sound in tubes: losses, formants",
    "mesh": "hexahedral meshes: generation, numbering, quality",
    "bones": "rigid surfaces: triangles, signed distance, motion",
    "materials": "material laws: one file per law",
    "elements": "elements and hourglass control",
    "effects": "effects that an elastic model lacks: one file per effect",
    "forces": "nodal forces: one file per force",
    "scenario": "scenario files: reading and validation",
    "results": "result files and typed reports",
    "measure": "measures: shape, speed, contact, airway, formants",
    "model": "models from scenarios: tongue, specimen, own mesh",
    "view": "pictures, terminal tables, HTML reports",
    "solve": "time integration, equilibria, single points",
    "measured": "datasets: reading, validation, SI units",
    "run": "commands on scenarios: run, check, bench",
    "predict": "response of a tissue in a measured test",
    "identify": "constants that fit a dataset",
    "close_loop": "effects that a dataset shows and the model lacks",
    "blind": "reliability of close-loop on hidden effects",
    "sweep": "parameter sweeps: designs, workers, tables",
    "verify": "validation claims and their references",
    "api": "Python functions for the commands",
}
# Entry points above all folders.
TOP = ("__init__", "__main__", "cli")
BASE = "errors"  # imported by nearly all folders; not drawn

WIDTH, HEIGHT, GAP, RISE = 2.75, 1.0, 0.3, 1.65  # of a box, between boxes, from level to level
LANE = 0.1  # width of an arrow that passes a level
MECHANICS, TEXT, STUDY, DRAWN = "#dbe7f3", "#fbeed3", "#e3efdc", "#f5dfdc"
SUBJECTS = dict.fromkeys(FOLDERS, MECHANICS)
SUBJECTS |= dict.fromkeys(("scenario", "model", "run", "host", "sweep", "api"), TEXT)
SUBJECTS |= dict.fromkeys(("measured", "predict", "identify", "close_loop", "blind", "verify"), STUDY)
SUBJECTS |= dict.fromkeys(("results", "measure", "view", "acoustics"), DRAWN)
LINE = "#5a6570"
LEGEND = """Arrows show imports. Arrows that follow from longer paths are omitted. errors.py is below all folders.
Blue: mechanics. Yellow: scenarios and runs. Green: measured data and validation. Red: results, measures, sound."""

Place = str | tuple[str, int]  # a folder, or the bend of the arrows to a folder where they pass a level


def folder_of(path: Path) -> str:
    """The folder of a module, or its own name if it is in the top folder of the package."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return parts[0]


def imported_folders(path: Path) -> set[str]:
    """Folders that a module imports from, also inside functions."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {name.split(".")[1] for name in names if name.startswith("explicitfe.")}


def read_graph() -> dict[str, set[str]]:
    """Folder -> the folders that it imports from."""
    modules = sorted(PACKAGE.rglob("*.py"))
    folders = {folder_of(path) for path in modules if path.parent != PACKAGE} - set(TOP)
    graph: dict[str, set[str]] = {folder: set() for folder in sorted(folders)}
    for path in modules:
        if folder_of(path) in folders:
            graph[folder_of(path)] |= (imported_folders(path) & folders) - {folder_of(path)}
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
        for folder in FOLDERS:
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


def draw(graph: dict[str, set[str]], path: Path) -> None:
    """Draw the picture and write it to a file."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import FancyBboxPatch

    levels = floors_of(graph)
    layout = Layout(levels, drawn_arrows(graph))
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
        box(x[folder], RISE * levels[folder], WIDTH, HEIGHT, folder, FOLDERS[folder], SUBJECTS[folder])
    words = "command line, `python -m explicitfe` and `import explicitfe`: import all folders"
    middle = 0.5 * (left + right)
    box(middle, top + 0.15, right - left - 2.0 * GAP, 0.75, "cli    __main__    __init__", words, "#f2f2f2")
    axes.text(middle, -0.2, LEGEND, ha="center", va="top", fontsize=11, color=LINE, linespacing=1.4)
    figure.savefig(path)


def main() -> None:
    graph = read_graph()
    unknown = set(graph) ^ set(FOLDERS)
    if unknown:
        sys.exit(f"FOLDERS must list exactly the folders of the package; these differ: {', '.join(sorted(unknown))}")
    try:
        levels = floors_of(graph)
    except CycleError as error:
        sys.exit(f"cyclic imports: {' -> '.join(error.args[1])}")
    total = sum(len(others) for others in graph.values())
    print(f"{len(graph)} folders, {total} arrows between folders ({len(drawn_arrows(graph))} drawn), ", end="")
    print(f"{max(levels.values()) + 1} levels, 0 cycles")
    for level in range(max(levels.values()), -1, -1):
        print(f"  {level:2d}  {', '.join(folder for folder in FOLDERS if levels[folder] == level)}")
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "architecture.png"
    draw(graph, path)


if __name__ == "__main__":
    main()
