"""How mesh density changes the answer: the tables and pictures of docs/studies/mesh-density.md.

    python studies/benchmarks/mesh_density.py OUT [--only sl-alone ...] [--largest HEXES] [--page docs]

Vowel [i], GGp, GGa and SL alone on five tongues from 384 to 34 992 hexes, all of one family (every number of cells times 1,
1.5, 2, 3 and 4.5), and on the medium one of 1 200; and the indentation on five specimens. Results stay in OUT, so that a stopped
study goes on; ``--largest 0 --page docs`` writes the page only. A table whose runs are missing stays as it is.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import tempfile
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import product
from pathlib import Path
from typing import Any

# Before numpy: threads of BLAS wait for each other in every look at the stable step, which costs much on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import matplotlib
import numpy as np
from elements import table
from scipy.optimize import brentq

import explicitfe
from explicitfe.app.view.palette import COLOURS, GRID
from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.quality import edge_lengths, scaled_jacobians, volumes
from explicitfe.fem.mesh.validity import certify
from explicitfe.results.files import Result
from explicitfe.results.files.differing_keys import WORDS
from explicitfe.results.measure.shape import grooves, highest_point
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.specimen import specimen_model
from explicitfe.simulate.scenario.read import read_scenario

matplotlib.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[2]
GESTURES = ("vowel-i", "ggp-alone", "gga-alone", "sl-alone")
INDENTATION = "indentation-rear"
# The coarse tongue times each factor: proportions and shares are then those of one family, exactly.
COARSE, MEDIUM = (12, 4, 8), (20, 6, 10)
FACTORS = (1.0, 1.5, 2.0, 3.0, 4.5)
COARSE_REFINEMENT = 0.5  # of the specimen, times the same factors
SECTOR_REFINEMENT = 4.0
AFFORDED = {"hex8": FACTORS, "hex8-stiffness": FACTORS, "hex8-full": FACTORS[:3]}

# What is stated as a limit: the three finest meshes change the quantity in one direction (vectors: within 45 degrees), with an
# order in this range ...
FEWEST = 3
ORDERS = (0.5, 4.0)
STRAIGHT = np.cos(np.radians(45.0))
# ... or a line through all meshes in h or h^2 ends at h = 0 with a standard error within this share of the quantity's size (or
# this many mm), and so little is the last change.
WITHIN, ROUNDING_mm = 0.02, 0.05
SHARE_FROM_mm = 0.5  # errors of quantities smaller than that are not given in %
PROBES = ("tip", "blade", "front", "dorsum", "back", "root", "base")


# ---- what is run ----


def cells_of(factor: float) -> tuple[int, ...]:
    return tuple(round(factor * n) for n in COARSE)


FAMILY = tuple(cells_of(factor) for factor in FACTORS)
TONGUES = (FAMILY[0], MEDIUM, *FAMILY[1:])


@dataclass(frozen=True)
class Run:
    """A gesture on one tongue."""

    gesture: str
    cells: tuple[int, ...]

    @property
    def path(self) -> Path:
        return ROOT / "scenarios" / f"{self.gesture}.toml"

    @property
    def settings(self) -> list[str]:
        kept = ["analysis.duration_ms=200", "analysis.threads=1", "record.every_ms=5", 'record.fields=["displacement"]']
        return [f"model.cells={list(self.cells)}", *kept]

    @property
    def key(self) -> str:
        """Name of the result's file; another scenario gives another name."""
        scenario, _ = read_scenario(self.path, self.settings)
        return f"{self.gesture}_{'x'.join(map(str, self.cells))}_{digest(scenario.model_dump(mode='json', exclude=set(WORDS)))}"

    @property
    def mesh(self) -> HexMesh:
        return tongue_mesh(self.cells)

    def compute(self, scratch: Path) -> dict[str, Any]:
        summary: Any = explicitfe.run(self.path, scratch, settings=self.settings)
        with explicitfe.open_result(Path(summary["result"])) as result:
            quantities = tongue_quantities(result) if summary["status"] == "finished" else ({}, {})
            return kept(summary, result) | dict(zip(("mm", "size_mm"), quantities, strict=True))


@dataclass(frozen=True)
class Specimen:
    """The indentation with one element on one mesh: of a quarter, or of a sector if asked for."""

    element: str
    factor: float
    sector: bool = False

    @property
    def gesture(self) -> str:
        return INDENTATION

    @property
    def scenario_path(self) -> Path:
        return ROOT / "scenarios" / f"{INDENTATION}.toml"

    @property
    def settings(self) -> list[str]:
        size = SECTOR_REFINEMENT if self.sector else COARSE_REFINEMENT * self.factor
        lines = [f"model.element={self.element}", 'record.fields=["displacement"]', f"model.refinement={size}"]
        return [*lines, f"model.symmetry={'sector' if self.sector else 'quarter'}"]

    @property
    def key(self) -> str:
        which = "sector" if self.sector else format(self.factor, "g")
        return f"{INDENTATION}-{self.element}_{which}_{digest(self.scenario_path.read_text(), self.settings)}"

    @property
    def mesh(self) -> HexMesh:
        return specimen_mesh(self.factor, self.sector)

    def compute(self, scratch: Path) -> dict[str, Any]:
        summary: Any = explicitfe.run(self.scenario_path, scratch, settings=self.settings)
        mm = {f"{point['force_N']:g} N": [point["displacement_mm"]] for point in summary["curve"]}
        with explicitfe.open_result(Path(summary["result"])) as result:
            answer = kept(summary, result)
        answer["steps"] = sum(load["iterations"] for load in summary["loads"])
        return answer | {"mm": mm, "size_mm": {name: abs(value) for name, (value,) in mm.items()}}


AnyRun = Run | Specimen


def digest(*parts: object) -> str:
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:10]


@cache
def tongue_mesh(cells: tuple[int, ...]) -> HexMesh:
    return catalogue.contour("tongue").mesh(cells)


@cache
def specimen_mesh(factor: float, sector: bool) -> HexMesh:
    run = Specimen("hex8", factor, sector)
    scenario: Any = read_scenario(run.scenario_path, run.settings)[0]
    return specimen_model(scenario.model, scenario.tool).mesh


def study() -> list[AnyRun]:
    """All runs, the coarse meshes first, so that a stopped study has results of every case."""
    every: list[AnyRun] = [Run(gesture, cells) for gesture, cells in product(GESTURES, TONGUES)]
    every += [Specimen(element, factor) for element, factors in AFFORDED.items() for factor in factors]
    every.append(Specimen("hex8", FACTORS[-1], sector=True))
    return sorted(every, key=lambda run: run.mesh.element_count)


# ---- what is read from a run ----


def kept(summary: Any, result: Result) -> dict[str, Any]:
    """How the run went."""
    return {
        "status": summary["status"],
        "hexes": summary["hexes"],
        "steps": summary.get("steps"),
        "seconds": summary["wall_s"],
        "balance": summary["energy_balance_error"],
        "hourglass": summary["hourglass_share_end"],
        "folded": certify(result.mesh.points + result.displacement(), result.mesh.hexes).folded_count,
    }


def tongue_quantities(result: Result) -> tuple[dict[str, list[float]], dict[str, float]]:
    """Quantities in mm, by their components, and their sizes: lengths of the probes' paths, and the others' own values."""
    paths = 1e3 * np.stack([result.probe(name) for name in PROBES], axis=1)
    quantities = {name: [-float(paths[-1, k, 0]), float(paths[-1, k, 2])] for k, name in enumerate(PROBES)}
    sizes = dict(zip(PROBES, np.linalg.norm(np.diff(paths, axis=0), axis=2).sum(axis=0).tolist(), strict=True))
    for name, value in shape_mm(result.mesh, result.displacement()).items():
        quantities[name], sizes[name] = [value], abs(value)
    return quantities, sizes


def shape_mm(mesh: HexMesh, displacement: np.ndarray) -> dict[str, float]:
    """Depth of the groove in the front section, and the rise of the highest point."""
    highest = highest_point(mesh, displacement)
    return {"groove": grooves(mesh, displacement)["front"].depth_mm, "height": highest.up_mm if highest else np.nan}


def read_answers(folder: Path) -> dict[AnyRun, dict[str, Any]]:
    """The results of all runs that are finished."""
    paths = {run: folder / f"{run.key}.json" for run in study()}
    return {run: json.loads(path.read_text(encoding="utf-8")) for run, path in paths.items() if path.is_file()}


def compute_all(folder: Path, only: Iterable[str], largest: int) -> None:
    """Compute the missing runs, and print the progress."""
    folder.mkdir(parents=True, exist_ok=True)
    wanted = [run for run in study() if run.gesture in only and run.mesh.element_count <= largest]
    missing = [run for run in wanted if not (folder / f"{run.key}.json").is_file()]
    for number, run in enumerate(missing, start=1):
        begin = time.perf_counter()
        with tempfile.TemporaryDirectory() as scratch:
            answer = run.compute(Path(scratch))
        if answer["status"] == "interrupted":
            raise SystemExit("stopped by hand; the same command goes on from here.")
        (folder / f"{run.key}.json").write_text(json.dumps(answer, indent=1), encoding="utf-8")
        took = f"{answer['steps']} steps, {time.perf_counter() - begin:.1f} s"
        print(f"{number}/{len(missing)} {run.gesture}, {answer['hexes']} hexes: {answer['status']}, {took}", flush=True)


# ---- where it goes under refinement ----


@dataclass(frozen=True)
class Limit:
    """The limit of a quantity on fine meshes, in mm, and the method that gave it; ``value`` is None if there is none."""

    value: np.ndarray | None
    how: str


def observed_order(h: np.ndarray, ratio: float) -> float | None:
    """The order p of v + c h^p whose changes between three meshes have this ratio; None outside ``ORDERS``."""

    def off(p: float) -> float:
        return (h[0] ** p - h[1] ** p) / (h[1] ** p - h[2] ** p) - ratio

    return brentq(off, *ORDERS) if off(ORDERS[0]) <= 0.0 <= off(ORDERS[1]) else None


def limit(h_mm: np.ndarray, values_mm: np.ndarray, size_mm: float) -> Limit:
    """The limit for h -> 0 of values (meshes, components), coarse meshes first."""
    if len(h_mm) < FEWEST:
        return Limit(None, "too few meshes")
    changes = np.diff(values_mm[-3:], axis=0)
    before, last = np.linalg.norm(changes, axis=1)
    if last > 0.0 and changes[0] @ changes[1] >= STRAIGHT * before * last:
        p = observed_order(h_mm[-3:], before / last)
        if p is not None:
            return Limit(values_mm[-1] + changes[1] * h_mm[-1] ** p / (h_mm[-2] ** p - h_mm[-1] ** p), f"order {p:.1f}")
    fits = []
    for p in (1, 2):
        columns = np.column_stack([np.ones_like(h_mm), h_mm**p])
        coefficients = np.linalg.lstsq(columns, values_mm, rcond=None)[0]
        scatter = np.linalg.norm(columns @ coefficients - values_mm) / np.sqrt(len(h_mm) - 2)
        fits.append((scatter, p, coefficients[0], scatter * np.sqrt(np.linalg.inv(columns.T @ columns)[0, 0])))
    _, p, value, doubt = min(fits, key=lambda fit: fit[0])
    if max(doubt, last) <= max(WITHIN * size_mm, ROUNDING_mm):
        return Limit(value, f"fit of order {p}, ± {doubt:.2g}")
    return Limit(None, "**no limit**")


@dataclass(frozen=True)
class Course:
    """One quantity over meshes, coarse ones first.

    h_mm : (m,); values_mm : (m, components); of_family : (m,) which meshes tell the limit, the others only have an error.
    """

    h_mm: np.ndarray
    values_mm: np.ndarray
    size_mm: float
    of_family: np.ndarray

    @cached_property
    def limit(self) -> Limit:
        return limit(self.h_mm[self.of_family], self.values_mm[self.of_family], self.size_mm)

    @cached_property
    def errors_mm(self) -> np.ndarray:
        """Distance of each mesh from the limit; NaN without one."""
        if self.limit.value is None:
            return np.full(len(self.h_mm), np.nan)
        return np.linalg.norm(self.values_mm - self.limit.value, axis=1)

    @cached_property
    def apart_mm(self) -> np.ndarray:
        """Distance of each mesh but the finest from the finest."""
        return np.linalg.norm(self.values_mm[:-1] - self.values_mm[-1:], axis=1)

    def percent(self, distance_mm: np.ndarray) -> np.ndarray:
        """A distance in % of the size; NaN for a quantity that is too small."""
        return 100.0 * distance_mm / (self.size_mm if self.size_mm >= SHARE_FROM_mm else np.nan)


def size_of_hexes_mm(mesh: HexMesh) -> float:
    return 1e3 * float(volumes(mesh.points, mesh.hexes).mean() ** (1.0 / 3.0))


Answers = dict[AnyRun, dict[str, Any]]


def course_of(runs: Sequence[AnyRun], quantity: str, answers: Answers, family: Sequence[bool]) -> Course:
    """The size, of which errors are a share, is that on the finest mesh."""
    return Course(
        np.array([size_of_hexes_mm(run.mesh) for run in runs]),
        np.array([answers[run]["mm"][quantity] for run in runs]),
        answers[runs[-1]]["size_mm"][quantity],
        np.array(family),
    )


def tongue_course(gesture: str, quantity: str, answers: Answers) -> Course:
    return course_of([Run(gesture, cells) for cells in TONGUES], quantity, answers, [cells in FAMILY for cells in TONGUES])


def specimen_course(element: str, load: str, answers: Answers) -> Course:
    factors = AFFORDED[element]
    return course_of([Specimen(element, factor) for factor in factors], load, answers, [True] * len(factors))


# ---- the page ----


def thousands(count: int) -> str:
    return f"{count:,}".replace(",", " ")


def vector(values: np.ndarray | None) -> str:
    """Components in mm; two of them are forward and up."""
    if values is None:
        return "–"
    return ", ".join(f"{x:+.2f}" for x in values) if len(values) > 1 else f"{values[0]:.2f}"


def errors(course: Course) -> list[str]:
    """Distances from the limit; without one, from the finest mesh, marked by a ~."""
    known = course.limit.value is not None
    distances = course.errors_mm if known else np.append(course.apart_mm, np.nan)
    mark = "" if known else "~"
    cells = []
    for mm, percent in zip(distances, course.percent(distances), strict=True):
        number = f"{mm:.2f}" if np.isnan(percent) else f"{mm:.2f} ({percent:.1f} %)"
        cells.append("–" if np.isnan(mm) else mark + number)
    return cells


TONGUE_HEAD = [thousands(int(np.prod(cells))) for cells in TONGUES]


def meshes_part(answers: Answers) -> str:
    """The meshes, and how much of their surface the bones hold."""
    rows = []
    shape = catalogue.contour("tongue")
    for cells in TONGUES:
        mesh = tongue_mesh(cells)
        of_family = next((f"x {factor:g}" for factor in FACTORS if cells_of(factor) == cells), "medium")
        held = [f"{1e4 * shape.attachment_points(cells, bone)[1].sum():.2f}" for bone in shape.fixed]
        smallest = f"{1e3 * edge_lengths(mesh.points, mesh.hexes).min():.2f}"
        flattest = f"{scaled_jacobians(mesh.points, mesh.hexes).min():.2f}"
        counted = thousands(mesh.element_count), f"{size_of_hexes_mm(mesh):.2f}"
        rows.append([of_family, ", ".join(map(str, cells)), *counted, smallest, flattest, *held])
    held_by = [f"attached to {bone}, cm²" for bone in shape.fixed]
    return table(("", "cells", "hexahedra", "h, mm", "smallest edge, mm", "smallest scaled Jacobian", *held_by), rows)


def answer_part(answers: Answers) -> str:
    """The probes of each gesture, and of all gestures, in one row."""
    courses = {gesture: [tongue_course(gesture, probe, answers) for probe in PROBES] for gesture in GESTURES}
    rows = [[name, *spread(some), limits(some)] for name, some in courses.items()]
    every = [course for some in courses.values() for course in some]
    rows.append(["**all**", *spread(every), limits(every)])
    return table(("gesture", *TONGUE_HEAD, "converged"), rows)


def limits(courses: Sequence[Course]) -> str:
    return f"{sum(course.limit.value is not None for course in courses)} of {len(courses)}"


def spread(courses: Sequence[Course]) -> list[str]:
    """Median and largest error on each mesh, mm and %: from the limit, or from the finest mesh where there is none."""
    off = np.array([
        np.append(course.apart_mm, 0.0) if course.limit.value is None else course.errors_mm for course in courses
    ])  # fmt: skip
    percent = np.array([course.percent(row) for course, row in zip(courses, off, strict=True)])
    percent = percent[np.isfinite(percent).all(axis=1)]
    return [
        f"{np.median(mm):.2f} / {mm.max():.2f} mm; {np.median(part):.1f} / {part.max():.1f} %"
        for mm, part in zip(off.T, percent.T, strict=True)
    ]


def finest_part(answers: Answers) -> str:
    """Root mean square distance of the probes of each gesture from the finest mesh, and the longest displacement there."""
    rows = []
    for gesture in GESTURES:
        courses = [tongue_course(gesture, probe, answers) for probe in PROBES]
        rms = np.sqrt(np.mean([course.apart_mm**2 for course in courses], axis=0))
        longest = max(np.linalg.norm(course.values_mm[-1]) for course in courses)
        rows.append([gesture, *(f"{mm:.2f}" for mm in rms), f"{longest:.1f}"])
    return table(("gesture", *TONGUE_HEAD[:-1], f"longest displacement, {TONGUE_HEAD[-1]}"), rows)


def all_part(answers: Answers) -> str:
    """Every quantity of every gesture: values, limit, errors."""
    parts = []
    for gesture in GESTURES:
        rows = []
        for name in (*PROBES, "groove", "height"):
            course = tongue_course(gesture, name, answers)
            values = [vector(value) for value in course.values_mm]
            rows.append([name, *values, vector(course.limit.value), course.limit.how, *errors(course)])
        head = ("", *TONGUE_HEAD, "limit", "extrapolation", *(f"error, {count}" for count in TONGUE_HEAD))
        parts.append(f"**{gesture}**\n\n{table(head, rows)}")
    return "\n\n".join(parts)


def runs_part(answers: Answers) -> str:
    """Steps, seconds, folded elements and the share of hourglass energy of every run of a tongue."""
    rows = []
    for gesture in GESTURES:
        some = [answers[Run(gesture, cells)] for cells in TONGUES]
        cells = [f"{one['steps']} / {one['seconds']:.0f} / {one['folded']} / {100 * one['hourglass']:.1f}" for one in some]
        rows.append([gesture, *cells, f"{max(one['balance'] for one in some):.0e}"])
    return table(("", *TONGUE_HEAD, "balance"), rows)


def indentation_part(answers: Answers) -> str:
    """Displacement under each load; beside it that of a fine sector, which computes the same body in another way."""
    fine = answers[Specimen("hex8", FACTORS[-1], sector=True)]
    rows = []
    for element, name in product(AFFORDED, LOADS):
        course = specimen_course(element, name, answers)
        empty = [""] * (len(FACTORS) - len(course.h_mm))
        values = [f"{value[0]:.3f}" for value in course.values_mm]
        value = "–" if course.limit.value is None else f"{course.limit.value[0]:.3f}"
        sector = f"{fine['mm'][name][0]:.3f}" if name in fine["mm"] else ""
        rows.append([element, name, *values, *empty, value, course.limit.how, *errors(course), *empty, sector])
    counts = [thousands(specimen_mesh(factor, False).element_count) for factor in FACTORS]
    head = (
        "element",
        "load",
        *counts,
        "limit",
        "extrapolation",
        *(f"error, {n}" for n in counts),
        f"sector, {thousands(fine['hexes'])}",
    )
    return table(head, rows)


indentation_scenario: Any = read_scenario(ROOT / "scenarios" / f"{INDENTATION}.toml")[0]
LOADS = tuple(f"{force:g} N" for force in indentation_scenario.analysis.forces_N)
PARTS = {
    "meshes": meshes_part,
    "answer": answer_part,
    "finest": finest_part,
    "all": all_part,
    "runs": runs_part,
    "indentation": indentation_part,
}


# ---- pictures ----


def draw_errors(axes: plt.Axes, course: Course, label: str, colour: str, marker: str) -> None:
    """Error against h; where there is no limit, the distance to the finest mesh, dotted and hollow."""
    if course.limit.value is not None:
        axes.plot(course.h_mm, course.errors_mm, "-", marker=marker, color=colour, label=f"{label}: {course.limit.how}")
        return
    how = course.limit.how.strip("*")
    axes.plot(course.h_mm[:-1], course.apart_mm, ":", marker=marker, mfc="white", color=colour, label=f"{label}: {how}")


def finish(panels: np.ndarray, titles: Sequence[str], heading: str) -> None:
    """The same scales in all panels, with room for the legend above; guides of order 1 and 2."""
    points = np.concatenate([line.get_xydata() for axes in panels.flat for line in axes.lines])
    points = points[(points > 0.0).all(axis=1)]
    h = points[:, 0].min() / 1.1, points[:, 0].max() * 1.1
    low, high = points[:, 1].min() / 1.5, points[:, 1].max() * 1.5
    for axes, title in zip(panels.flat, titles, strict=True):
        axes.set_xscale("log")
        axes.set_yscale("log")
        for p, name in ((1, "h"), (2, "h²")):
            guide = high * np.array([(h[0] / h[1]) ** p, 1.0])
            axes.plot(h, guide, "-", lw=0.8, color="0.7", zorder=0)
            axes.annotate(name, (h[0], guide[0]), (3, 2), textcoords="offset points", color="0.5", fontsize=9)
        axes.set_xlim(h)
        axes.set_ylim(low, high * (high / low) ** 0.4)
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("{x:g}")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.tick_params(axis="x", which="minor", labelsize=8)
        axes.grid(color=GRID, lw=0.6, which="both")
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_title(title, fontsize=10, loc="left")
        axes.legend(fontsize=7, loc="upper left", ncols=2, framealpha=0.9)
    for axes in panels[-1]:
        axes.set_xlabel("h = (volume / hexahedra)$^{1/3}$, mm")
    for axes in panels[:, 0]:
        axes.set_ylabel("error, mm")
    panels.flat[0].figure.suptitle(heading, fontsize=11, x=0.01, ha="left")


DOTTED = "\nDotted: no limit seen; distance to the finest mesh instead"


def draw_tongue(answers: Answers, path: Path) -> None:
    """Tip and dorsum, every gesture."""
    figure, panels = plt.subplots(
        1, 2, figsize=(10.0, 5.0), dpi=160, layout="constrained", sharex=True, sharey=True, squeeze=False
    )
    courses = {probe: [tongue_course(gesture, probe, answers) for gesture in GESTURES] for probe in ("tip", "dorsum")}
    for some, axes in zip(courses.values(), panels.flat, strict=True):
        for gesture, course, colour, marker in zip(GESTURES, some, COLOURS, "osD^", strict=False):
            draw_errors(axes, course, gesture, colour, marker)
    lost = any(course.limit.value is None for some in courses.values() for course in some)
    heading = "Tongue: error of the displacement at 200 ms against the size of the hexahedra"
    finish(panels, list(courses), heading + (DOTTED if lost else ""))
    figure.savefig(path)
    plt.close(figure)


def draw_indentation(answers: Answers, path: Path) -> None:
    """Three loads with the default element; the last load with every element."""
    figure, panels = plt.subplots(
        1, 2, figsize=(10.0, 5.0), dpi=160, layout="constrained", sharex=True, sharey=True, squeeze=False
    )
    left, right = panels.flat
    for name, colour, marker in zip((LOADS[0], LOADS[3], LOADS[-1]), COLOURS, "osD", strict=False):
        draw_errors(left, specimen_course("hex8", name, answers), name, colour, marker)
    for element, colour, marker in zip(AFFORDED, COLOURS[3:], "osD", strict=False):
        draw_errors(right, specimen_course(element, LOADS[-1], answers), element, colour, marker)
    titles = ["hex8, three loads", f"{LOADS[-1]}, every element"]
    finish(panels, titles, "Indentation: error of the tool's displacement against the size of the hexes" + DOTTED)
    figure.savefig(path)
    plt.close(figure)


def write_page(answers: Answers, folder: Path) -> None:
    """Tables between the marks of mesh-density.md, and the pictures; those whose runs are missing stay as they are."""
    page = folder / "studies" / "mesh-density.md"
    text = page.read_text(encoding="utf-8")
    missing = {run.gesture for run in study() if run not in answers}
    tongue, specimen = missing.isdisjoint(GESTURES), INDENTATION not in missing
    for name, part in PARTS.items():
        if name != "meshes" and not (specimen if name == "indentation" else tongue):
            print(f"{name}: runs are missing, so its table stays as it is")
            continue
        mark, end = f"<!-- {name} -->", f"<!-- end {name} -->"
        before, following = text.split(mark)
        text = before + mark + "\n\n" + part(answers) + "\n\n" + end + following.split(end)[1]
    page.write_text(text, encoding="utf-8")
    if tongue:
        draw_tongue(answers, folder / "pictures" / "mesh-density-tongue.png")
    if specimen:
        draw_indentation(answers, folder / "pictures" / "mesh-density-indentation.png")
    print(f"written: {page}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path, help="folder of what was computed")
    names = [*GESTURES, INDENTATION]
    parser.add_argument("--only", nargs="+", choices=names, default=names, help="what to run")
    parser.add_argument("--largest", type=int, default=10**9, help="run no mesh with more hexes")
    parser.add_argument("--page", type=Path, help="folder of the pages: put in the tables, draw the pictures")
    arguments = parser.parse_args()
    compute_all(arguments.out, arguments.only, arguments.largest)
    if arguments.page:
        write_page(read_answers(arguments.out), arguments.page)


if __name__ == "__main__":
    main()
