"""Family "febio": a cylinder between glued plates by FEBio (Maas et al. 2012, J. Biomech. Eng. 134:011005), if it is installed.

The executable is that of the environment variable FEBIO, or febio4, febio3 or febio on the PATH. Where there is none, make.py
skips these cases and says so. The decks are of the format 4.0: a quarter of the cylinder in hex8 elements with three fields,
Mooney-Rivlin with c2 = 0 (neo-Hookean), relaxation by "uncoupled viscoelastic". Tests and distances are those of glued.py.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import glued
import numpy as np
from glued_solver import POISSON_OF_CONSTANT_VOLUME
from sealed import Request, RowNoise, Sealed, truth_of

from explicitfe.platform.errors import RunError
from studies.blind.draws import C10_RANGE_PA
from studies.blind.foreign.law import HiddenTissue
from studies.blind.foreign.tool_tests import RigReading

EXECUTABLES = ("febio4", "febio3", "febio")
SINGLES = ("viscoelastic", "two-terms", "compressible", "layer", "force-offset", "force-drift", "lag")
PAIRS = (("viscoelastic", "force-offset"), ("compressible", "force-drift"))
OUTSIDE = {"ring": (), "soft-core": ()}
CELLS = 12  # across the radius of the quarter, and over half of the height
GRADING = 2.5  # the cells at the rims are so many times smaller than those inside
MATERIALS = 24  # levels of the stiffness, where it varies from place to place
INSTANTS_OF_A_SEGMENT = 10
LONGEST_S = 3600.0


def executable() -> str | None:
    """The path of FEBio; None where it is not installed."""
    stated = os.environ.get("FEBIO")
    if stated:
        return stated if Path(stated).is_file() else None
    return next((path for name in EXECUTABLES if (path := shutil.which(name))), None)


def choices(kind: str) -> list[tuple[str, ...]]:
    """What a kind of case can hide."""
    if kind == "control":
        return [()]
    if kind == "pair":
        return list(PAIRS)
    return [(name,) for name in (SINGLES if kind == "single" else OUTSIDE)]


def draw(rng: np.random.Generator, request: Request) -> Sealed:
    """Draw a case.

    Raises
    ------
    RunError : FEBio is not installed, or does not end normally.
    """
    tissue = HiddenTissue(float(f"{np.exp(rng.uniform(*np.log(C10_RANGE_PA))):.4g}"))
    tests, curves = glued.plan_tests(rng, tissue, by_force=False)
    largest = max(float(np.abs(c.force(t.imposed(t.rows))).max()) for t, c in zip(tests, curves, strict=True))
    deepest = max(x for test in tests for _, x in test.corners)
    noise = RowNoise(
        float(f"{rng.choice(glued.LEVELS) * largest:.3g}"),
        float(f"{rng.choice(glued.IMPOSED_LEVELS) * deepest:.3g}"),
        bool(rng.random() >= glued.UNSTATED_SHARE),
    )
    effects, distance = glued.identifiable(rng, request, glued.Rivals(tests, curves, tissue, False, noise))
    hidden, reading = glued.hide(tissue, effects)
    columns = [answer(test, hidden, reading) for test in tests]
    truth = truth_of(
        request,
        setting="tool",
        effects=effects,
        accepts=(),
        constants=(tissue.C10_Pa, 0.0),
        noise=noise,
        distance=distance,
        protocol="glued plates, displacement imposed",
        rows=sum(map(len, columns)),
    )
    return Sealed(glued.dataset(rng, tests, columns, noise, by_force=False), truth)


def answer(test: glued.GluedTest, tissue: HiddenTissue, reading: RigReading) -> np.ndarray:
    """The force (k,) [N] at the rows of a test.

    Raises
    ------
    RunError : FEBio is not installed, or does not end normally.
    """
    program = executable()
    if program is None:
        raise RunError("FEBio was not found; set FEBIO to its executable.")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "test.feb"
        path.write_bytes(deck(test, tissue))
        try:
            run = subprocess.run(
                [program, "-i", path.name], cwd=folder, capture_output=True, text=True, timeout=LONGEST_S, check=False
            )
        except subprocess.TimeoutExpired:
            raise RunError(f"FEBio has not ended after {LONGEST_S:g} s.") from None
        output = Path(folder) / "force.csv"
        if "N O R M A L" not in run.stdout or not output.is_file():
            raise RunError(f"FEBio did not end normally: {run.stdout[-200:]}")
        time_s, force_N = read_forces(output.read_text(encoding="utf-8"))
    column = np.interp(test.rows - reading.lag_s, time_s, force_N)
    return reading.read(column, test.rows)


def read_forces(text: str) -> tuple[np.ndarray, np.ndarray]:
    """Times (m,) [s] and the force on the whole plate (m,) [N], pressing positive, from FEBio's file of nodal reactions.

    Its records begin with lines "*Step", "*Time" and "*Data", and then have a node and its reaction along z in each line.
    """
    times, forces = [0.0], [0.0]
    for line in text.splitlines():
        if line.startswith("*Time"):
            times.append(float(line.partition("=")[2]))
            forces.append(0.0)
        elif line.strip() and not line.startswith("*"):
            forces[-1] -= 4.0 * float(line.split(",")[-1])  # a quarter is computed
    return np.array(times), np.array(forces)


# ---- the deck ----


def deck(test: glued.GluedTest, tissue: HiddenTissue) -> bytes:
    """The FEBio input file of a test; mm, N, MPa and s."""
    points, cells = mesh(test.specimen.radius_mm, test.specimen.height_mm)
    root = ET.Element("febio_spec", version="4.0")
    ET.SubElement(root, "Module", type="solid")
    times = instants(test)
    control = ET.SubElement(root, "Control")
    step = float(times[-1]) / len(times)
    _texts(control, analysis="STATIC", time_steps=str(len(times)), step_size=f"{step:.9g}")
    stepper = ET.SubElement(control, "time_stepper", type="default")
    _texts(stepper, max_retries="20", opt_iter="11", dtmin=f"{1e-6 * step:.9g}")
    ET.SubElement(stepper, "dtmax", lc="2").text = "1"
    solver = ET.SubElement(control, "solver", type="solid")
    _texts(solver, symmetric_stiffness="symmetric", dtol="1e-5", etol="1e-6", rtol="0")
    middles = points[cells].mean(axis=1)
    factor = tissue.moduli_factor(np.hypot(middles[:, 0], middles[:, 1]), middles[:, 2], test.specimen.height_mm)
    levels = np.unique(factor)
    if len(levels) > MATERIALS:
        levels = np.linspace(factor.min(), factor.max(), MATERIALS)
    level = np.argmin(np.abs(factor[:, None] - levels), axis=1)
    materials = ET.SubElement(root, "Material")
    for k, value in enumerate(levels):
        _material(materials, k + 1, tissue, float(value))
    box = ET.SubElement(root, "Mesh")
    nodes = ET.SubElement(box, "Nodes", name="all")
    for k, place in enumerate(points):
        ET.SubElement(nodes, "node", id=str(k + 1)).text = ",".join(f"{x:.9g}" for x in place)
    for k in range(len(levels)):
        part = ET.SubElement(box, "Elements", type="hex8", name=f"part-{k + 1}")
        for number in np.flatnonzero(level == k):
            ET.SubElement(part, "elem", id=str(number + 1)).text = ",".join(str(n + 1) for n in cells[number])
    for name, members in _sets(points, test.specimen.height_mm).items():
        ET.SubElement(box, "NodeSet", name=name).text = ",".join(str(n + 1) for n in members)
    domains = ET.SubElement(root, "MeshDomains")
    for k in range(len(levels)):
        ET.SubElement(domains, "SolidDomain", name=f"part-{k + 1}", mat=f"tissue-{k + 1}", type="three-field-solid")
    _boundary(root)
    data = ET.SubElement(root, "LoadData")
    _curve(data, 1, "LINEAR", [(t, -x) for t, x in test.corners])  # the plate moves down
    steps = np.diff(times, append=times[-1] + step)
    _curve(data, 2, "STEP", [(float(t), float(dt)) for t, dt in zip(times, steps, strict=True)])
    log = ET.SubElement(ET.SubElement(root, "Output"), "logfile")
    top = _sets(points, test.specimen.height_mm)["top"]
    ET.SubElement(log, "node_data", data="Rz", file="force.csv", delim=",").text = ",".join(str(n + 1) for n in top)
    return ET.tostring(root, encoding="ISO-8859-1", xml_declaration=True)


def instants(test: glued.GluedTest) -> np.ndarray:
    """Times that FEBio must meet [s], from the first one after rest on."""
    share = np.expm1(np.linspace(0.0, 1.0, INSTANTS_OF_A_SEGMENT + 1)[1:] * np.log(30.0)) / 29.0
    even = np.arange(1, INSTANTS_OF_A_SEGMENT + 1) / INSTANTS_OF_A_SEGMENT
    pairs = zip(test.corners, test.corners[1:], strict=False)
    return np.concatenate([t0 + (t1 - t0) * (share if x0 == x1 else even) for (t0, x0), (t1, x1) in pairs])


def mesh(radius_mm: float, height_mm: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) of a quarter of a cylinder [mm], and its hexahedra (e, 8) in FEBio's order: base, then top."""
    s = _graded(CELLS)
    x, y = np.meshgrid(s, s, indexing="ij")
    flat = radius_mm * np.stack([x * np.sqrt(1.0 - 0.5 * y**2), y * np.sqrt(1.0 - 0.5 * x**2)], axis=-1).reshape(-1, 2)
    half = _graded(CELLS)
    z = height_mm * 0.5 * np.concatenate([1.0 - half[::-1], (1.0 + half)[1:]])
    points = np.concatenate([np.column_stack([flat, np.full(len(flat), level)]) for level in z])
    n = CELLS + 1
    i, j, k = (axis.ravel() for axis in np.meshgrid(range(CELLS), range(CELLS), range(len(z) - 1), indexing="ij"))
    first = i * n + j + n * n * k
    base = np.stack([first, first + n, first + n + 1, first + 1], axis=1)
    return points, np.concatenate([base, base + n * n], axis=1)


def _graded(cells: int) -> np.ndarray:
    """Places from 0 to 1 with intervals that shrink towards 1."""
    sizes = np.geomspace(GRADING, 1.0, cells)
    return np.concatenate([[0.0], np.cumsum(sizes) / sizes.sum()])


def _sets(points: np.ndarray, height_mm: float) -> dict[str, np.ndarray]:
    x, y, z = np.abs(points).T
    near = 1e-9 * height_mm
    return {
        "base": np.flatnonzero(z < near),
        "top": np.flatnonzero(z > height_mm - near),
        "plane-x": np.flatnonzero(x < near),
        "plane-y": np.flatnonzero(y < near),
    }


def _material(parent: ET.Element, number: int, tissue: HiddenTissue, factor: float) -> None:
    """Mooney-Rivlin, relaxing or not; FEBio's shares are of the long-term stress, those of the tissue of the sudden one."""
    lasting = 1.0 - sum(g for g, _ in tissue.prony)
    nu = min(tissue.poisson, POISSON_OF_CONSTANT_VOLUME)
    c1 = 1e-6 * tissue.C10_Pa * factor
    bulk = 4.0 * c1 * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu))
    kind = "uncoupled viscoelastic" if tissue.prony else "Mooney-Rivlin"
    own = ET.SubElement(parent, "material", id=str(number), name=f"tissue-{number}", type=kind)
    _texts(own, density="1e-9", k=f"{bulk:.9g}")
    if not tissue.prony:
        _texts(own, c1=f"{c1:.9g}", c2="0")
        return
    for k, (g, tau) in enumerate(tissue.prony, start=1):
        _texts(own, **{f"g{k}": f"{g / lasting:.9g}", f"t{k}": f"{tau:.9g}"})
    elastic = ET.SubElement(own, "elastic", type="Mooney-Rivlin")
    _texts(elastic, density="1e-9", k=f"{bulk:.9g}", c1=f"{c1 * lasting:.9g}", c2="0")


def _boundary(root: ET.Element) -> None:
    boundary = ET.SubElement(root, "Boundary")
    for name, dofs in (("base", "xyz"), ("top", "xy"), ("plane-x", "x"), ("plane-y", "y")):
        held = ET.SubElement(boundary, "bc", name=f"held-{name}", type="zero displacement", node_set=name)
        _texts(held, **{f"{axis}_dof": "1" if axis in dofs else "0" for axis in "xyz"})
    moved = ET.SubElement(boundary, "bc", name="moved", type="prescribed displacement", node_set="top")
    _texts(moved, dof="z", relative="0")
    ET.SubElement(moved, "value", lc="1").text = "1"


def _curve(parent: ET.Element, number: int, kind: str, points: Sequence[tuple[float, float]]) -> None:
    curve = ET.SubElement(parent, "load_controller", id=str(number), type="loadcurve")
    _texts(curve, interpolate=kind, extend="CONSTANT")
    inside = ET.SubElement(curve, "points")
    for t, value in points:
        ET.SubElement(inside, "pt").text = f"{t:.9g},{value:.9g}"


def _texts(parent: ET.Element, **entries: str) -> None:
    for key, value in entries.items():
        ET.SubElement(parent, key).text = value
