"""How mesh density changes the answer: the tables and pictures of docs/mesh-density.md.

    python benchmarks/mesh_density.py OUT [--only sl-alone ...] [--largest HEXES] [--page docs]

Vowel [i], GGp, GGa and SL alone on five tongues from 480 to 43 740 hexes, all of one family (every number of cells times 1,
1.5, 2, 3 and 4.5), and the indentation on five specimens. Results stay in OUT, so that a stopped study goes on;
``--largest 0 --page docs`` writes the page only.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, replace
from functools import cache, cached_property
from itertools import product
from pathlib import Path
from typing import Any

# Before numpy: threads of BLAS wait for each other in every look at the stable step, which costs much on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import matplotlib
import numpy as np
from elements import table
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

import explicitfe
from explicitfe.measure.sections import groove_depth, midsagittal, section
from explicitfe.mesh.bent_block import Patch
from explicitfe.mesh.hexmesh import FACES, HexMesh
from explicitfe.mesh.quality import corner_jacobians, edge_lengths, volumes
from explicitfe.model import catalogue
from explicitfe.model.specimen import specimen_model
from explicitfe.results import Result
from explicitfe.scenario.read import read_scenario
from explicitfe.view.palette import COLOURS, GRID

matplotlib.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[1]
MUSCLES = {"vowel-i": ("GGp", "GGa"), "ggp-alone": ("GGp",), "gga-alone": ("GGa",), "sl-alone": ("SL",)}
INDENTATION = "indentation-rear"
# The coarse tongue times each factor: proportions and shares are then those of one family, exactly.
COARSE = (10, 6, 8)
FACTORS = (1.0, 1.5, 2.0, 3.0, 4.5)
COARSE_REFINEMENT = 0.5  # of the specimen, times the same factors
SECTOR_REFINEMENT = 4.0
IN_VIVO, CADAVER = "buchaillard-2009", "gerard-2005"
TISSUES = {IN_VIVO: "in vivo", CADAVER: "cadaver"}
ENDS, ALONG = "ends", "along"
AFFORDED = {"hex8": FACTORS, "hex8-stiffness": FACTORS, "hex8-full": FACTORS[:3]}
# Bones hold the nodes nearest to their patches: on every mesh another part of the surface. To tell how much that does, the
# patches of the coarse tongue are also held on meshes that have its planes of nodes.
SAME_PATCHES = (1.0, 2.0, 3.0)

# What is stated as a limit: the three finest meshes change the quantity in one direction (vectors: within 45 degrees), with an
# order in this range ...
FEWEST = 3
ORDERS = (0.5, 4.0)
STRAIGHT = np.cos(np.radians(45.0))
# ... or a line through all meshes in h or h^2 ends at h = 0 with a standard error within this share of the quantity's size (or
# this many mm), and so little is the last change.
WITHIN, ROUNDING_mm = 0.02, 0.05
SHARE_FROM_mm = 0.5  # errors of quantities smaller than that are not given in %

# For the estimate of the time: ns per element and step; steps on the coarse tongue and how they grow with the factor; iterations
# of eight loads, which grow as the factor does.
NS = {"hex8": 65.0, "hex8-stiffness": 50.0, "hex8-full": 330.0}
STEPS = {IN_VIVO: 2500.0, CADAVER: 1200.0}
STEPS_GROW, ITERATIONS = 1.5, 10_000.0
BESIDES_s, BESIDES_A_HEX_s = 0.3, 1e-4  # building, reading
PROBES = ("tip", "blade", "front", "dorsum", "back", "root", "base")


# ---- what is run ----


@dataclass(frozen=True)
class Case:
    """A question that is answered on finer and finer meshes; the fields after ``element`` belong to a tongue only."""

    scenario: str
    element: str = "hex8"
    tissue: str = CADAVER
    distribution: str = ""
    same_patches: bool = False  # bones hold what they hold on the coarse mesh

    @property
    def factors(self) -> tuple[float, ...]:
        return SAME_PATCHES if self.same_patches else AFFORDED[self.element]

    @property
    def pull(self) -> str:
        return self.distribution + (", same patches" if self.same_patches else "")

    @property
    def tongue(self) -> bool:
        return self.scenario in MUSCLES

    @property
    def words(self) -> str:
        return " ".join(x for x in (self.scenario, TISSUES[self.tissue], self.pull, self.element) if x)


@dataclass(frozen=True)
class Run:
    """A case on one mesh; a specimen is a quarter, or a sector if asked for."""

    case: Case
    factor: float
    sector: bool = False

    @cached_property
    def settings(self) -> list[str]:
        lines = [f"model.element={self.case.element}", 'record.fields=["displacement"]']
        if not self.case.tongue:
            size = SECTOR_REFINEMENT if self.sector else COARSE_REFINEMENT * self.factor
            return [*lines, f"model.symmetry={'sector' if self.sector else 'quarter'}", f"model.refinement={size}"]
        lines += [f"model.cells={list(cells_of(self.factor))}", f"model.material={self.case.tissue}", "record.every_ms=5"]
        return lines + [f"muscle.{name}.distribution={self.case.distribution}" for name in MUSCLES[self.case.scenario]]

    @property
    def scenario_path(self) -> Path:
        return ROOT / "scenarios" / f"{self.case.scenario}.toml"

    @property
    def mesh(self) -> HexMesh:
        return tongue_mesh(self.factor) if self.case.tongue else specimen_mesh(self.factor, self.sector)

    @property
    def key(self) -> str:
        """Name of the result's file; another scenario text or another setting gives another name."""
        digest = hashlib.sha256(json.dumps([self.scenario_path.read_text(), self.settings]).encode()).hexdigest()[:10]
        words = "-".join(self.case.words.replace(",", "").split())
        return f"{words}_{'sector' if self.sector else format(self.factor, 'g')}_{digest}"

    @property
    def estimate_s(self) -> float:
        count = self.mesh.element_count
        if self.case.tongue:
            steps = STEPS[self.case.tissue] * self.factor**STEPS_GROW
        else:
            steps = ITERATIONS * max(FACTORS[2], SECTOR_REFINEMENT / COARSE_REFINEMENT if self.sector else self.factor)
        return 1e-9 * NS[self.case.element] * count * steps + BESIDES_s + BESIDES_A_HEX_s * count


def cells_of(factor: float) -> tuple[int, ...]:
    return tuple(round(factor * n) for n in COARSE)


@cache
def tongue_mesh(factor: float) -> HexMesh:
    return catalogue.contour("tongue").mesh(cells_of(factor))


@cache
def specimen_mesh(factor: float, sector: bool) -> HexMesh:
    run = Run(Case(INDENTATION), factor, sector)
    scenario, _ = read_scenario(run.scenario_path, run.settings)
    return specimen_model(scenario.model, scenario.tool).mesh


def cases() -> list[Case]:
    """The default element with both tissues and distributions; the other elements with stiff tissue and spread forces only."""
    listed = [
        Case(scenario, "hex8", tissue, distribution)
        for tissue, distribution, scenario in product((IN_VIVO, CADAVER), (ENDS, ALONG), MUSCLES)
    ]
    others = ("hex8-stiffness", "hex8-full")
    listed += [Case(scenario, element, IN_VIVO, ALONG) for element, scenario in product(others, MUSCLES)]
    listed += [Case(scenario, "hex8", IN_VIVO, ALONG, same_patches=True) for scenario in MUSCLES]
    return [*listed, *(Case(INDENTATION, element) for element in AFFORDED)]


def runs_of(case: Case) -> list[Run]:
    return [Run(case, factor) for factor in case.factors]


def study() -> list[Run]:
    """All runs, the coarse meshes first, so that a stopped study has results of every case."""
    every = [run for case in cases() for run in runs_of(case)]
    every.append(Run(Case(INDENTATION), FACTORS[-1], sector=True))
    return sorted(every, key=lambda run: run.mesh.element_count)


# ---- what is read from a run ----


@contextmanager
def coarse_patches() -> Iterator[None]:
    """Within this context bones hold every tongue on the patches of the coarse one."""
    contour = catalogue.contour
    shape = contour("tongue")
    cells = np.array([COARSE[0], COARSE[1], COARSE[2] // 2])

    def on_plane(patch: Patch, bound: Sequence[float]) -> tuple[float, ...]:
        place = np.array(bound)
        if patch.row is not None:  # the middle of the strip
            place[patch.row] = 0.5 * (patch.lower[patch.row] + patch.upper[patch.row])
        return tuple((np.floor(cells * place + 0.5) / cells).tolist())

    held = {
        name: tuple(Patch(on_plane(patch, patch.lower), on_plane(patch, patch.upper)) for patch in patches)
        for name, patches in shape.attachments.items()
    }
    catalogue.contour = lambda _: replace(shape, attachments=held)
    try:
        yield
    finally:
        catalogue.contour = contour


def compute(run: Run, folder: Path) -> dict[str, Any]:
    """Run, and keep the numbers that the page needs: the components of each quantity (``mm``), and its 100 % (``size_mm``)."""
    with coarse_patches() if run.case.same_patches else nullcontext():
        summary = explicitfe.run(run.scenario_path, folder, settings=run.settings, overwrite=True)
    answer: dict[str, Any] = {
        "run": asdict(run),
        "settings": run.settings,
        "status": summary["status"],
        "message": summary["message"],
        "hexes": summary["hexes"],
        "steps": summary["steps"] if run.case.tongue else sum(load["iterations"] for load in summary["loads"]),
        "seconds": summary["wall_s"],
        "balance": summary["energy_balance_error"],
        "hourglass": summary["hourglass_share_end"],
        "min_J": summary["min_J"],
        "mm": {},
        "size_mm": {},
    }
    path = Path(summary["result"])
    with explicitfe.open_result(path) as result:
        # Corners on a sector's axis have no volume to begin with.
        reference = corner_jacobians(result.mesh.points, result.mesh.hexes)
        now = corner_jacobians(result.mesh.points + result.displacement(), result.mesh.hexes)
        answer["folded"] = int(np.sum(np.any((now <= 0.0) & (reference > 1e-6 * reference.max()), axis=1)))
        if not run.case.tongue:
            answer["mm"] = {f"{point['force_N']:g} N": [point["displacement_mm"]] for point in summary["curve"]}
            answer["size_mm"] = {name: abs(value) for name, (value,) in answer["mm"].items()}
        elif summary["status"] == "finished":
            answer["mm"], answer["size_mm"] = tongue_quantities(result)
    path.unlink()
    return answer


def tongue_quantities(result: Result) -> tuple[dict[str, list[float]], dict[str, float]]:
    """Quantities in mm and their sizes.

    The groove is cut at the front section of the smooth shape.
    """
    shape = catalogue.contour("tongue")
    mesh = result.mesh
    paths = 1e3 * np.stack([result.probe(name) for name in PROBES], axis=1)
    u = result.displacement()

    quantities = {name: [-float(paths[-1, k, 0]), float(paths[-1, k, 2])] for k, name in enumerate(PROBES)}
    sizes = dict(zip(PROBES, np.linalg.norm(np.diff(paths, axis=0), axis=2).sum(axis=0).tolist(), strict=True))
    often = np.linspace(result.times[0], result.times[-1], 1000)
    for name in ("tip", "dorsum"):
        away = CubicSpline(result.times, np.linalg.norm(paths[:, PROBES.index(name)], axis=1))(often)
        quantities[f"{name}, largest"] = [float(away.max())]
        sizes[f"{name}, largest"] = sizes[name]
    cut = section(mesh, 0, float(shape.position(shape.named_points["front"])[0]))
    outline = midsagittal(mesh)
    quantities["groove"] = [1e3 * groove_depth(cut.at(mesh.points), cut.at(mesh.points + u))]
    highest = [float(outline.at(mesh.points + moved)[:, 2].max()) for moved in (0.0 * u, u)]
    quantities["height"] = [1e3 * (highest[1] - highest[0])]
    return quantities, sizes | {name: abs(quantities[name][0]) for name in ("groove", "height")}


def read_answers(folder: Path) -> dict[Run, dict[str, Any]]:
    """The results of all runs that are finished."""
    computed = {}
    for run in study():
        path = folder / f"{run.key}.json"
        if path.is_file():
            computed[run] = json.loads(path.read_text(encoding="utf-8"))
    return computed


def compute_all(folder: Path, only: Iterable[str], largest: int) -> None:
    """Compute the missing runs, and print the progress."""
    folder.mkdir(parents=True, exist_ok=True)
    wanted = [run for run in study() if run.case.scenario in only and run.mesh.element_count <= largest]
    missing = [run for run in wanted if not (folder / f"{run.key}.json").is_file()]
    left_s = sum(run.estimate_s for run in missing)
    print(f"{len(missing)} of {len(wanted)} runs to do, about {left_s / 60:.0f} min on a quiet core", flush=True)
    for number, run in enumerate(missing, start=1):
        begin = time.perf_counter()
        with tempfile.TemporaryDirectory() as scratch:
            answer = compute(run, Path(scratch))
        if answer["status"] == "interrupted":
            raise SystemExit("stopped by hand; the same command goes on from here.")
        (folder / f"{run.key}.json").write_text(json.dumps(answer, indent=1), encoding="utf-8")
        left_s -= run.estimate_s
        print(
            f"{number}/{len(missing)} {run.case.words}, {answer['hexes']} hexes: {answer['status']}, {answer['steps']} steps, "
            f"{time.perf_counter() - begin:.1f} s (estimated {run.estimate_s:.1f}); {left_s / 60:.1f} min left",
            flush=True,
        )


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
    """One quantity of one case over the meshes that have it: h in mm, values (meshes, components) and sizes in mm."""

    factors: list[float]
    h_mm: np.ndarray
    values_mm: np.ndarray
    size_mm: float

    @cached_property
    def limit(self) -> Limit:
        return limit(self.h_mm, self.values_mm, self.size_mm)

    @cached_property
    def errors_mm(self) -> np.ndarray:
        """Distance of each mesh from the limit; NaN without one."""
        if self.limit.value is None:
            return np.full(len(self.h_mm), np.nan)
        return np.linalg.norm(self.values_mm - self.limit.value, axis=1)

    @property
    def percent(self) -> np.ndarray:
        """The same in % of the size; NaN for a quantity too small for that."""
        return self.share(self.errors_mm)

    @cached_property
    def apart_mm(self) -> np.ndarray:
        """Distance of each mesh but the finest from the finest."""
        if not self.factors:
            return np.empty(0)
        return np.linalg.norm(self.values_mm[:-1] - self.values_mm[-1:], axis=1)

    def share(self, distance_mm: np.ndarray) -> np.ndarray:
        """A distance in % of the size; NaN for a quantity that is too small."""
        return 100.0 * distance_mm / (self.size_mm if self.size_mm >= SHARE_FROM_mm else np.nan)

    @property
    def changes_percent(self) -> np.ndarray:
        """From each mesh to the next, in % of the size."""
        if not self.factors:
            return np.empty(0)
        return 100.0 * np.linalg.norm(np.diff(self.values_mm, axis=0), axis=1) / self.size_mm


def size_of_hexes_mm(mesh: HexMesh) -> float:
    return 1e3 * float(volumes(mesh.points, mesh.hexes).mean() ** (1.0 / 3.0))


def course(case: Case, quantity: str, answers: dict[Run, dict[str, Any]]) -> Course:
    """The size, of which errors are a share, is that on the finest mesh."""
    having = [run for run in runs_of(case) if quantity in answers.get(run, {}).get("mm", {})]
    return Course(
        [run.factor for run in having],
        np.array([size_of_hexes_mm(run.mesh) for run in having]),
        np.array([answers[run]["mm"][quantity] for run in having]),
        answers[having[-1]]["size_mm"][quantity] if having else 0.0,
    )


# ---- the page ----


def thousands(count: int) -> str:
    return f"{count:,}".replace(",", " ")


def vector(values: np.ndarray | None) -> str:
    """Components in mm; two of them are forward and up."""
    if values is None:
        return "–"
    return ", ".join(f"{x:+.2f}" for x in values) if len(values) > 1 else f"{values[0]:.2f}"


def over_meshes(factors: Sequence[float], cells: Sequence[str]) -> list[str]:
    """One cell for each factor; cells without a result stay empty."""
    known = dict(zip(factors, cells, strict=True))
    return [known.get(factor, "") for factor in FACTORS]


def errors(course: Course) -> list[str]:
    """Distances from the limit; without one, from the finest mesh, marked by a ~."""
    known = course.limit.value is not None
    distances = course.errors_mm if known else np.append(course.apart_mm, np.nan)
    mark = "" if known else "~"
    cells = []
    for mm, percent in zip(distances, course.share(distances), strict=True):
        number = f"{mm:.2f}" if np.isnan(percent) else f"{mm:.2f} ({percent:.1f} %)"
        cells.append("–" if np.isnan(mm) else mark + number)
    return over_meshes(course.factors, cells[: len(course.factors)])


def hexes_head(tongue: bool = True) -> list[str]:
    case = Case("vowel-i" if tongue else INDENTATION)
    return [thousands(Run(case, factor).mesh.element_count) for factor in FACTORS]


def meshes_part(answers: dict[Run, dict[str, Any]]) -> str:
    """The meshes, and how much of their surface the bones hold."""
    rows = []
    for factor in FACTORS:
        mesh, specimen = tongue_mesh(factor), specimen_mesh(factor, False)
        cells = [str(n) for n in cells_of(factor)]
        rows.append([
            f"{factor:g}", ", ".join(cells), thousands(mesh.element_count), f"{size_of_hexes_mm(mesh):.2f}",
            f"{1e3 * edge_lengths(mesh.points, mesh.hexes).min():.2f}",
            *(f"{1e4 * held_area(mesh, bone):.1f}" for bone in ("jaw", "hyoid")),
            f"{COARSE_REFINEMENT * factor:g}", thousands(specimen.element_count), f"{size_of_hexes_mm(specimen):.2f}",
        ])  # fmt: skip
    head = (
        "factor", "tongue: cells", "hexes", "h, mm", "smallest edge, mm", "held by jaw, cm²", "by hyoid, cm²",
        "specimen: refinement", "hexes", "h, mm",
    )  # fmt: skip
    return table(head, rows)


def held_area(mesh: HexMesh, bone: str) -> float:
    """Area of the faces held by a bone, m²."""
    inside = np.zeros(mesh.node_count, dtype=bool)
    inside[mesh.node_sets[bone]] = True
    faces = mesh.hexes[:, FACES].reshape(-1, 4)
    a, b, c, d = mesh.points[faces[inside[faces].all(axis=1)]].transpose(1, 0, 2)
    return 0.5 * float(np.linalg.norm(np.cross(c - a, d - b), axis=1).sum())


def groups() -> dict[tuple[str, str, str], list[Case]]:
    """The cases of the tongue by element, tissue and how it is pulled and held."""
    grouped: dict[tuple[str, str, str], list[Case]] = {}
    for case in cases():
        if case.tongue:
            grouped.setdefault((case.element, case.tissue, case.pull), []).append(case)
    return grouped


def answer_part(answers: dict[Run, dict[str, Any]]) -> str:
    """All probes of all gestures in one row: errors, where there is a limit, and changes from mesh to mesh, which need none."""
    off, apart, changed = [], [], []
    for (element, tissue, pull), some in groups().items():
        courses = [(case.scenario, course(case, probe, answers)) for case, probe in product(some, PROBES)]
        judged = [(name, one) for name, one in courses if len(one.h_mm) >= FEWEST]
        without = [name for name, one in judged if one.limit.value is None]
        words = ", ".join(f"{name} {without.count(name)}" for name in MUSCLES if name in without)
        lost = f"{len(without)} of {len(judged)}" + (f": {words}" if words else "")
        labels = [element, TISSUES[tissue], pull]
        off.append([*labels, *spread([(one.factors, one.percent) for _, one in courses]), lost])
        apart.append([*labels, *spread([(one.factors[:-1], one.share(one.apart_mm)) for _, one in courses])])
        changed.append([*labels, *spread([(one.factors[1:], one.changes_percent) for _, one in courses])])
    head = ("element", "tissue", "distribution", *hexes_head())
    return (
        f"Error in % of the probe's path, median / largest:\n\n{table((*head, 'no limit'), off)}\n\n"
        f"Distance from the finest mesh in % of the path, median / largest, with and without a limit:\n\n{table(head, apart)}\n\n"
        f"Change from the mesh before in % of the path, median / largest, with and without a limit:\n\n{table(head, changed)}"
    )


def spread(some: Iterable[tuple[Sequence[float], np.ndarray]]) -> list[str]:
    """Median and largest of many quantities on each mesh; each comes with the factors of the meshes that have it."""
    every: dict[float, list[float]] = {}
    for factors, values in some:
        for factor, value in zip(factors, values, strict=True):
            if np.isfinite(value):
                every.setdefault(factor, []).append(float(value))
    return [f"{np.median(every[factor]):.1f} / {max(every[factor]):.1f}" if factor in every else "" for factor in FACTORS]


def tip_part(answers: dict[Run, dict[str, Any]]) -> str:
    rows = []
    for (element, tissue, pull), some in groups().items():
        for case, probe in product(some, ("tip", "dorsum")):
            one = course(case, probe, answers)
            labels = [case.scenario, probe, element, TISSUES[tissue], pull]
            rows.append([*labels, vector(one.limit.value), one.limit.how, *errors(one)])
    head = ("gesture", "probe", "element", "tissue", "distribution", "limit, mm", "found by", *hexes_head())
    return table(head, rows)


def all_part(answers: dict[Run, dict[str, Any]]) -> str:
    """Every quantity of the default element: values, limit, errors."""
    names = (*PROBES, "tip, largest", "dorsum, largest", "groove", "height")
    parts = []
    for case in cases():
        if not case.tongue or case.element != "hex8" or case.same_patches:
            continue
        rows = []
        for name in names:
            one = course(case, name, answers)
            values = over_meshes(one.factors, [vector(value) for value in one.values_mm])
            rows.append([name, *values, vector(one.limit.value), one.limit.how, *errors(one)])
        head = ("", *hexes_head(), "limit", "found by", *(f"off, {count}" for count in hexes_head()))
        parts.append(f"**{case.scenario}, {TISSUES[case.tissue]}, `{case.distribution}`**\n\n{table(head, rows)}")
    return "\n\n".join(parts)


def runs_part(answers: dict[Run, dict[str, Any]]) -> str:
    """Steps, seconds and folded elements of every run, with its status where that is not "finished"."""
    rows = []
    for case in cases():
        cells, balances, hourglass = [], [], []
        runs = [run for run in runs_of(case) if run in answers]
        for run in runs:
            answer = answers[run]
            status = "" if answer["status"] == "finished" else f"**{answer['status']}**: "
            cells.append(f"{status}{answer['steps']} / {answer['seconds']:.1f} / {answer['folded']}")
            balances.append(answer["balance"])
            hourglass.append(f"{100 * answer['hourglass']:.0f}")
        cells = over_meshes([run.factor for run in runs], cells)
        largest = f"{max(balances):.0e}" if balances else ""
        labels = [case.scenario, case.element, TISSUES[case.tissue], case.pull]
        rows.append([*labels, *cells, largest, ", ".join(hourglass)])
    head = ("", "element", "tissue", "distribution", *(f"x {factor:g}" for factor in FACTORS), "balance", "hourglass, %")
    return table(head, rows)


def indentation_part(answers: dict[Run, dict[str, Any]]) -> str:
    """Displacement under each load; beside it that of a fine sector, which computes the same body in another way."""
    fine = answers.get(Run(Case(INDENTATION), FACTORS[-1], sector=True))
    rows = []
    for element, name in product(AFFORDED, LOADS):
        one = course(Case(INDENTATION, element), name, answers)
        values = over_meshes(one.factors, [f"{value[0]:.3f}" for value in one.values_mm])
        value = "–" if one.limit.value is None else f"{one.limit.value[0]:.3f}"
        sector = f"{fine['mm'][name][0]:.3f}" if fine and name in fine["mm"] else ""
        rows.append([element, name, *values, value, one.limit.how, *errors(one), sector])
    sector_head = f"sector, {thousands(fine['hexes'])}" if fine else "sector"
    counts = hexes_head(tongue=False)
    return table(("element", "load", *counts, "limit", "found by", *(f"off, {n}" for n in counts), sector_head), rows)


LOADS = tuple(f"{force:g} N" for force in read_scenario(ROOT / "scenarios" / f"{INDENTATION}.toml")[0].analysis.forces_N)
PARTS = {
    "answer": answer_part,
    "meshes": meshes_part,
    "tip": tip_part,
    "indentation": indentation_part,
    "runs": runs_part,
    "all": all_part,
}


# ---- pictures ----


def draw_errors(axes: plt.Axes, one: Course, label: str, colour: str, marker: str) -> None:
    """Error against h; where there is no limit, the distance to the finest mesh, dotted and hollow."""
    if len(one.h_mm) < 2:
        return
    if one.limit.value is not None:
        axes.plot(one.h_mm, one.errors_mm, "-", marker=marker, color=colour, label=f"{label}: {one.limit.how}")
        return
    axes.plot(
        one.h_mm[:-1], one.apart_mm, ":", marker=marker, mfc="white", color=colour, label=f"{label}: {one.limit.how.strip('*')}"
    )


def finish(panels: np.ndarray, titles: Sequence[str], heading: str) -> None:
    """The same scales in all panels, with room for the legend above; guides of order 1 and 2."""
    drawn = [line.get_xydata() for axes in panels.flat for line in axes.lines]
    points = np.concatenate(drawn or [np.ones((1, 2))])
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
        if axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize=8, loc="upper left", ncols=2, framealpha=0.9)
    for axes in panels[-1]:
        axes.set_xlabel("h = (volume / hexes)$^{1/3}$, mm")
    for axes in panels[:, 0]:
        axes.set_ylabel("error, mm")
    heading += "\nDotted: no limit seen; distance to the finest mesh instead"
    panels.flat[0].figure.suptitle(heading, fontsize=11, x=0.01, ha="left")


def draw_tongue(answers: dict[Run, dict[str, Any]], path: Path) -> None:
    """Tip and dorsum, both distributions, in-vivo tissue."""
    figure, panels = plt.subplots(2, 2, figsize=(10.0, 8.5), dpi=160, layout="constrained", sharex=True, sharey=True)
    titles = []
    for (distribution, probe), axes in zip(product((ENDS, ALONG), ("tip", "dorsum")), panels.flat, strict=True):
        for name, colour, marker in zip(MUSCLES, COLOURS, "osD^", strict=False):
            draw_errors(axes, course(Case(name, "hex8", IN_VIVO, distribution), probe, answers), name, colour, marker)
        titles.append(f"{probe}, distribution {distribution}")
    finish(panels, titles, "Tongue, in-vivo tissue, hex8: error of the displacement at 120 ms against the size of the hexes")
    figure.savefig(path)
    plt.close(figure)


def draw_indentation(answers: dict[Run, dict[str, Any]], path: Path) -> None:
    """Three loads with the default element; the last load with every element."""
    figure, panels = plt.subplots(
        1, 2, figsize=(10.0, 5.0), dpi=160, layout="constrained", sharex=True, sharey=True, squeeze=False
    )
    left, right = panels.flat
    for name, colour, marker in zip((LOADS[0], LOADS[3], LOADS[-1]), COLOURS, "osD", strict=False):
        draw_errors(left, course(Case(INDENTATION), name, answers), name, colour, marker)
    for element, colour, marker in zip(AFFORDED, COLOURS[3:], "osD", strict=False):
        draw_errors(right, course(Case(INDENTATION, element), LOADS[-1], answers), element, colour, marker)
    titles = ["hex8, three loads", f"{LOADS[-1]}, every element"]
    finish(panels, titles, "Indentation: error of the tool's displacement against the size of the hexes")
    figure.savefig(path)
    plt.close(figure)


def write_page(answers: dict[Run, dict[str, Any]], folder: Path) -> None:
    """Tables between the marks of mesh-density.md, and the pictures."""
    page = folder / "mesh-density.md"
    text = page.read_text(encoding="utf-8")
    for name, part in PARTS.items():
        mark, end = f"<!-- {name} -->", f"<!-- end {name} -->"
        before, following = text.split(mark)
        text = before + mark + "\n\n" + part(answers) + "\n\n" + end + following.split(end)[1]
    page.write_text(text, encoding="utf-8")
    draw_tongue(answers, folder / "pictures" / "mesh-density-tongue.png")
    draw_indentation(answers, folder / "pictures" / "mesh-density-indentation.png")
    print(f"written: {page}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path, help="folder of what was computed")
    names = [*MUSCLES, INDENTATION]
    parser.add_argument("--only", nargs="+", choices=names, default=names, help="scenarios to run")
    parser.add_argument("--largest", type=int, default=10**9, help="run no mesh with more hexes")
    parser.add_argument("--page", type=Path, help="folder with mesh-density.md: put in the tables, draw the pictures")
    arguments = parser.parse_args()
    compute_all(arguments.out, arguments.only, arguments.largest)
    if arguments.page:
        write_page(read_answers(arguments.out), arguments.page)


if __name__ == "__main__":
    main()
