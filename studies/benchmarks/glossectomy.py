"""What a glossectomy does to three gestures, with and without a flap or a scar, and what other muscles can make up for it.

    python studies/benchmarks/glossectomy.py table [--mesh medium] [--out outputs/glossectomy]
    python studies/benchmarks/glossectomy.py formants [--mesh medium] [--out outputs/glossectomy]
    python studies/benchmarks/glossectomy.py search [--out outputs/glossectomy]
    python studies/benchmarks/glossectomy.py picture [--out outputs/glossectomy]

``table`` runs every resection and reconstruction in every gesture, and prints the tables of docs/studies/surgery.md; ``picture``
draws them beside shapes of two runs. ``search`` looks for forces that bring a gesture back: what it moves, and how, stands at
``SEARCHES``.

Mobility is that of the tissue that is left in every reconstruction of a resection: with u and u0 the displacements after surgery
and of the intact tongue, sum V u . u0 / sum V u0 . u0 over its nodes, V the volume at each. 1: it moves as before, along the same
way. "off" is the root of sum V |u - u0|^2 / sum V.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from mouth import distances
from scipy.optimize import lsq_linear

from explicitfe.fem.mesh.hexmesh import HexMesh
from explicitfe.fem.mesh.quality import volumes
from explicitfe.fem.mesh.triangles import plane_segments
from explicitfe.results.files import open_result
from explicitfe.results.measure.document import Measures
from explicitfe.results.measure.formants import airway_of
from explicitfe.results.measure.measure import measures_of
from explicitfe.results.measure.sections import X, Y, Z, midsagittal, section
from explicitfe.results.measure.steps import last_step
from explicitfe.results.measure.tract import palate_midline
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.run.run import run
from explicitfe.simulate.scenario.read import read_scenario

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ROOT = Path(__file__).resolve().parents[2]

# Gesture -> scenario.
GESTURES = {"[i]": "vowel-i", "[a]": "vowel-a", "[t]": "alveolar-t", "tip up": "sl-alone"}
ENDS_MS = {"[t]": 140.0}  # while it is closed; the others at the end of their scenario

# The speaker's right side is y > 0. Sizes are choices of this project.
RESECTIONS = {
    "lateral": "box_mm=[[-99.0, 7.0, 86.0], [95.0, 99.0, 200.0]]",
    "anterior": "plane={point_mm=[70.0, 0.0, 0.0], normal=[-1.0, 0.0, 0.0]}",
    "mouth floor": "box_mm=[[-99.0, -99.0, 0.0], [105.0, 99.0, 70.0]]",
    "half": "box_mm=[[-99.0, 0.0, 82.0], [105.0, 99.0, 200.0]]",
}
# The flap's moduli over the tissue's; None: nothing is put in. Thickness and stiffness of scars are choices of this project too.
SCAR = "scar={thickness_mm=2.0, stiffness_ratio=6.0}"
RECONSTRUCTIONS: dict[str, tuple[float | None, bool]] = {
    "none": (None, False),
    "none, scar": (None, True),
    "flap x 1": (1.0, False),
    "flap x 3": (3.0, False),
    "flap x 6": (6.0, False),
    "flap x 3, scar": (3.0, True),
}
POINTS = ("tip", "blade", "front", "dorsum", "back")


def surgery(resection: str, reconstruction: str) -> list[str]:
    """Settings of a scenario."""
    ratio, scarred = RECONSTRUCTIONS[reconstruction]
    region = RESECTIONS[resection]
    settings = [f"resection=[{{{region}}}]"]
    settings += [] if ratio is None else [f"graft=[{{{region}, stiffness_ratio={ratio}}}]"]
    return settings + ([SCAR] if scarred else [])


@dataclass(frozen=True)
class Run:
    """What a run came to at its end: ``displacement`` (n, 3) m of the nodes of ``mesh``."""

    mesh: HexMesh
    displacement: np.ndarray
    measures: Measures
    status: str
    muscle_loss_percent: Mapping[str, float]


def computed(gesture: str, mesh: str, settings: Sequence[str], folder: Path) -> Run:
    """A gesture with settings, run unless its result is there."""
    target = folder / f"{GESTURES[gesture]}.vtkhdf"
    stated = [f"model.resolution={mesh}", "record.every_ms=4", 'record.fields=["velocity"]', *settings]
    stated += [f"analysis.duration_ms={ENDS_MS[gesture]}"] if gesture in ENDS_MS else []
    note = folder / f"{GESTURES[gesture]}.json"
    if not (target.is_file() and note.is_file() and json.loads(note.read_text(encoding="utf-8")) == stated):
        folder.mkdir(parents=True, exist_ok=True)
        summary = run(ROOT / "scenarios" / f"{GESTURES[gesture]}.toml", folder, settings=stated, overwrite=True)
        if summary["status"] == "finished":
            note.write_text(json.dumps(stated), encoding="utf-8")
    with open_result(target) as result:
        step = last_step(result)
        report = result.model["surgery"] or {"muscle_loss_percent": {}}
        measures = measures_of(result, step)
        return Run(result.mesh, result.displacement(step), measures, result.status, report["muscle_loss_percent"])


class Tissue:
    """The tissue that is left after a resection, and how the nodes of other meshes are those of its nodes."""

    def __init__(self, mesh: HexMesh) -> None:
        share = np.repeat(volumes(mesh.points, mesh.hexes) / 8.0, 8)
        self.volume = np.bincount(mesh.hexes.ravel(), share, mesh.node_count)
        self.mesh = mesh

    def of(self, other: Run) -> np.ndarray:
        """Displacements (n, 3) m of its nodes in another run."""
        number = {place.tobytes(): k for k, place in enumerate(other.mesh.points)}
        return other.displacement[[number[place.tobytes()] for place in self.mesh.points]]

    def mobility(self, u: np.ndarray, intact: np.ndarray) -> float:
        return float(self.volume @ (u * intact).sum(axis=1) / (self.volume @ (intact * intact).sum(axis=1)))

    def off_mm(self, u: np.ndarray, intact: np.ndarray) -> float:
        return 1e3 * float(np.sqrt(self.volume @ np.square(u - intact).sum(axis=1) / self.volume.sum()))


def foremost(run: Run) -> tuple[str, float]:
    """The foremost point that is left, and how far it went to the speaker's right, mm."""
    name = next(name for name in POINTS if name in run.measures.points)
    return name, run.measures.points[name].right_mm


def row(gesture: str, resection: str, reconstruction: str, done: Run, intact: Run, tissue: Tissue) -> dict[str, object]:
    """The numbers of one run."""
    u, u0 = tissue.of(done), tissue.of(intact)
    measures = done.measures
    name, right_mm = foremost(done)
    points = {point: (at.forward_mm, at.up_mm, at.right_mm) for point, at in measures.points.items()}
    contact, constriction = measures.contact["palate"], measures.constriction
    assert constriction is not None
    return {
        "gesture": gesture,
        "resection": resection,
        "reconstruction": reconstruction,
        "status": done.status,
        "lost_percent": dict(done.muscle_loss_percent),
        "mobility": tissue.mobility(u, u0),
        "off_mm": tissue.off_mm(u, u0),
        "foremost": name,
        "right_mm": right_mm,
        "points_mm": points,
        "contact_mm2": contact.area_mm2,
        "width_mm": constriction.width_mm,
        "peak_speed_mm_s": measures.points["dorsum"].peak_speed_mm_s,
    }


def cells(values: dict[str, object]) -> str:
    """A row of the table."""
    points: Mapping[str, tuple[float, float, float]] = values["points_mm"]  # type: ignore[assignment]

    def point(name: str) -> str:
        return f"{points[name][0]:+.1f}, {points[name][1]:+.1f}" if name in points else ""

    numbers = [values[key] for key in ("mobility", "off_mm", "right_mm", "contact_mm2", "width_mm", "peak_speed_mm_s")]
    mobility, off, right, contact, width, speed = (float(number) for number in numbers)  # type: ignore[arg-type]
    text = [str(values["resection"]), str(values["reconstruction"]), f"{100 * mobility:.0f}", f"{off:.1f}"]
    text += [point(name) for name in ("tip", "front", "dorsum")]
    return "| " + " | ".join([*text, f"{right:+.1f}", f"{contact:.0f}", f"{width:.1f}", f"{speed:.0f}"]) + " |"


HEAD = ("resection", "reconstruction", "mobility, %", "rms distance, mm", "tip", "front", "dorsum", "to the right", "palate, mm²",
        "constriction, mm", "peak speed, mm/s")  # fmt: skip


def table(mesh: str, out: Path) -> None:
    """Run everything, print tables, store the numbers."""
    rows = []
    for gesture in GESTURES:
        intact = computed(gesture, mesh, [], out / mesh / "intact")
        whole = row(gesture, "intact", "", intact, intact, Tissue(intact.mesh))
        rows.append(whole)
        print(
            f"\n**{gesture}** (`{GESTURES[gesture]}`)\n\n| {' | '.join(HEAD)} |\n|{'---|' * len(HEAD)}\n{cells(whole)}",
            flush=True,
        )
        for resection in RESECTIONS:
            tissue: Tissue | None = None
            for reconstruction in RECONSTRUCTIONS:
                folder = out / mesh / f"{resection}-{reconstruction}".replace(" ", "-").replace(",", "")
                done = computed(gesture, mesh, surgery(resection, reconstruction), folder)
                tissue = tissue or Tissue(done.mesh)
                rows.append(row(gesture, resection, reconstruction, done, intact, tissue))
                print(cells(rows[-1]), flush=True)
                if done.status != "finished":
                    print(f"  {done.status}", flush=True)
    (out / f"{mesh}.json").write_text(json.dumps(rows, indent=1), encoding="utf-8")
    for rows_of in ([r for r in rows if r["gesture"] == gesture and r["reconstruction"] == "none"] for gesture in GESTURES):
        for values in rows_of:
            print(values["gesture"], values["resection"], {k: round(v, 1) for k, v in values["lost_percent"].items()})  # type: ignore[attr-defined]


def formants(mesh: str, out: Path) -> None:
    """F1 to F3 of [i] in Hz, intact and after each resection, with lips of the usual area."""
    cases = [("intact", "", []), *((a, b, surgery(a, b)) for a in RESECTIONS for b in ("none", "flap x 1", "flap x 6"))]
    print("| resection | reconstruction | F1 | F2 | F3 |\n|---|---|---|---|---|")
    for resection, reconstruction, settings in cases:
        folder = out / f"{mesh}-formants" / f"{resection}-{reconstruction}".replace(" ", "-")
        computed("[i]", mesh, settings, folder)
        with open_result(folder / f"{GESTURES['[i]']}.vtkhdf") as result:
            answer = airway_of(result, last_step(result))
        text = " | ".join(f"{formant.frequency_hz:.0f}" for formant in answer.formants)
        print(f"| {resection} | {reconstruction} | {text or 'closed'} |", flush=True)


# ---- what others can make up for ----


@dataclass(frozen=True)
class Search:
    """What is to be brought back, and which muscles may pull otherwise.

    Gauss-Newton: slopes by ``FORCE_STEP_N``, at most ``TURNS`` steps, each halved twice if it makes things
    worse. Forces stay between 0 and 15 % of a muscle's maximum (of that of a side, where sides pull apart). Beside the residuals
    the squares of (change of force / N) count, times ``PRICE_MM_N`` squared.

    Attributes
    ----------
    closure : what counts is the midsagittal gap to the palate around where the intact tongue comes nearest [mm], 1/50 of the
        touched area [mm2], and 0.3 of the way of dorsum and back [mm]; else the way of every point that is left [mm].
    sides : whether left and right may pull apart.
    mesh : that it is looked for on.
    """

    gesture: str
    resection: str
    reconstruction: str
    muscles: tuple[str, ...]
    sides: bool
    closure: bool
    mesh: str = "coarse"


SEARCHES = (
    Search("[i]", "half", "none", ("GGp", "GGa", "GGm", "SL", "TRANS", "MH"), True, False),
    Search("[i]", "half", "flap x 3", ("GGp", "GGa", "GGm", "SL", "TRANS", "MH"), True, False),
    Search("[t]", "anterior", "none", ("SL", "GGm", "GGp", "GGa", "MH", "TRANS"), False, True, "medium"),
)
TURNS = 2
FORCE_STEP_N = 0.1
PRICE_MM_N = 0.1
LARGEST_SHARE = 0.15  # of a muscle's maximum
AROUND_PLACE_MM = 8.0
TOUCHED_WEIGHT_1_MM = 0.02
BACK_WEIGHT = 0.3


def gap_mm(run: Run, place_mm: float) -> float:
    """Smallest midsagittal distance of the tongue from the palate's midline around a place along it, 0 where they overlap."""
    surface = catalogue.bones("tongue")["palate"].surface
    line = palate_midline(surface.points[surface.triangles], 0.0)
    assert line is not None
    places = np.arange(max(0.0, place_mm - AROUND_PLACE_MM), min(1e3 * line.length[-1], place_mm + AROUND_PLACE_MM), 0.5)
    cut = midsagittal(run.mesh)
    outline = cut.at(run.mesh.points + run.displacement)[max(cut.loops, key=len)][:, [X, Z]]
    return 1e3 * float(distances(line.at(1e-3 * places), outline).min())


def residuals(search: Search, done: Run, intact: Run) -> np.ndarray:
    """What is not as in the intact tongue, mm."""
    assert intact.measures.constriction is not None
    ways = [
        [getattr(run.measures.points[name], f"{way}_mm") for run in (done, intact)]
        for name in (POINTS[3:] if search.closure else POINTS)
        if name in done.measures.points
        for way in ("forward", "up", "right")
    ]
    off = np.subtract(*np.array(ways).T)
    if not search.closure:
        return off
    place = intact.measures.constriction.place_mm
    touched = [run.measures.contact["palate"].area_mm2 for run in (done, intact)]
    gap = gap_mm(done, place) - gap_mm(intact, place)
    return np.array([gap, TOUCHED_WEIGHT_1_MM * (touched[0] - touched[1]), *(BACK_WEIGHT * off)])


def pulls(search: Search, forces_N: np.ndarray) -> list[str]:
    """The setting of the muscles."""
    sides = ("left", "right") if search.sides else ("both",)
    entries = [
        f'{{name="{name}", side="{side}", force_N={force}, profile="ramp", rise_ms=50.0, distribution="stress"}}'
        for (name, side), force in zip(product(search.muscles, sides), forces_N.tolist(), strict=True)
        if force > 0.0
    ]
    return [f"muscle=[{', '.join(entries)}]"]


def looked_for(search: Search, out: Path, mesh: str) -> None:
    """Search, and print what came of it on the mesh of the search and on ``mesh``."""
    anatomy = catalogue.built_in("tongue", search.mesh)
    scenario, _ = read_scenario(ROOT / "scenarios" / f"{GESTURES[search.gesture]}.toml")
    stated = {muscle.name: muscle.force_N for muscle in scenario.muscle}  # type: ignore[union-attr]
    sides = 2 if search.sides else 1
    start = np.repeat([stated.get(name, 0.0) for name in search.muscles], sides) / sides
    most = np.repeat([LARGEST_SHARE * anatomy.muscles[name].max_force_N for name in search.muscles], sides) / sides
    cut = surgery(search.resection, search.reconstruction)
    folder = out / "search"
    intact = computed(search.gesture, search.mesh, [], out / search.mesh / "intact")

    def miss(forces_N: np.ndarray) -> np.ndarray:
        done = computed(search.gesture, search.mesh, [*cut, *pulls(search, forces_N)], folder)
        return residuals(search, done, intact)

    forces, r = start, miss(start)
    first = r
    for _ in range(TURNS):
        columns = []
        for k in range(len(forces)):
            ahead = forces.copy()
            ahead[k] += FORCE_STEP_N
            columns.append((miss(ahead) - r) / FORCE_STEP_N)
        system = np.vstack([np.column_stack(columns), PRICE_MM_N * np.eye(len(forces))])
        wanted = -np.append(r, PRICE_MM_N * (forces - start))
        change = lsq_linear(system, wanted, bounds=(-forces - 1e-9, most - forces + 1e-9)).x
        cost = r @ r + PRICE_MM_N**2 * np.square(forces - start).sum()
        for share in (1.0, 0.5, 0.25):
            new = np.clip(forces + share * change, 0.0, most).round(3)
            off = miss(new)
            if off @ off + PRICE_MM_N**2 * np.square(new - start).sum() < cost:
                forces, r = new, off
                break
        else:
            break
        print(f"  {np.sqrt(np.mean(r * r)):.2f} mm", flush=True)

    names = [f"{name} {side}".strip() for name, side in product(search.muscles, ("left", "right") if search.sides else ("",))]
    print(f"{search.gesture}, {search.resection}, {search.reconstruction}: rms of the residuals {np.sqrt(np.mean(first**2)):.2f} "
          f"-> {np.sqrt(np.mean(r * r)):.2f} mm on the {search.mesh} mesh")  # fmt: skip
    print("  " + ", ".join(f"{name} {a:g} -> {b:g}" for name, a, b in zip(names, start, forces, strict=True)) + " N", flush=True)
    whole = computed(search.gesture, mesh, [], out / mesh / "intact")
    for what, forces_N in (("before", start), ("after", forces)):
        done = computed(search.gesture, mesh, [*cut, *pulls(search, forces_N)], folder)
        off, tissue = residuals(search, done, whole), Tissue(done.mesh)
        assert whole.measures.constriction is not None
        text = f"  {what} on the {mesh} mesh, {done.status}: rms {np.sqrt(np.mean(off * off)):.2f} mm, all tissue "
        text += f"{tissue.off_mm(tissue.of(done), tissue.of(whole)):.2f} mm off, {foremost(done)} mm to the right, palate "
        text += (
            f"{done.measures.contact['palate'].area_mm2:.0f} mm2, gap {gap_mm(done, whole.measures.constriction.place_mm):.2f} mm"
        )
        print(text, off.round(2).tolist(), flush=True)


# ---- picture ----

# Resection, gesture, the axis across the cut, where it is at rest [mm], and the axes drawn to the right and up.
VIEWS = (
    ("half", "[i]", X, 80.0, Y, Z),
    ("half", "[i]", Z, 98.0, X, Y),
    ("anterior", "[t]", Y, 0.0, X, Z),
    ("mouth floor", "[i]", Y, 0.0, X, Z),
)
CUTS = {X: "coronal", Y: "midsagittal", Z: "from above"}
AXES = {X: "front  ←  x, mm  →  back", Y: "left  ←  y, mm  →  right", Z: "z, mm"}


def picture(mesh: str, out: Path, target: Path) -> None:
    """Bars of mobility, and shapes: what the intact tongue does, and what is left of it."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    rows = json.loads((out / f"{mesh}.json").read_text(encoding="utf-8"))
    figure = plt.figure(figsize=(13.0, 8.4))
    top, bottom = figure.add_gridspec(2, 1, hspace=0.38, left=0.06, right=0.99, top=0.95, bottom=0.06)
    bars, shapes = top.subgridspec(1, len(GESTURES), wspace=0.12), bottom.subgridspec(1, len(VIEWS), wspace=0.25)
    colours = ["#4d4d4d", "#a6a6a6", "#c6dbef", "#6baed6", "#08519c", "#d9a441"]
    for number, gesture in enumerate(GESTURES):
        axes = figure.add_subplot(bars[number])
        for k, reconstruction in enumerate(RECONSTRUCTIONS):
            heights = [
                100.0 * next(r["mobility"] for r in rows if (r["gesture"], r["resection"], r["reconstruction"]) == at)
                for at in ((gesture, resection, reconstruction) for resection in RESECTIONS)
            ]
            places = np.arange(len(heights)) + 0.13 * (k - 2.5)
            label = {"none": "no flap", "none, scar": "no flap, scar"}.get(reconstruction, reconstruction.replace(" x ", " × "))
            axes.bar(places, heights, 0.12, color=colours[k], label=label)
        axes.axhline(100.0, color="black", lw=0.8)
        axes.set_xticks(range(len(RESECTIONS)), list(RESECTIONS), fontsize=8)
        axes.set_title(f"{gesture} ({GESTURES[gesture]})", fontsize=10)
        axes.set_ylim(0.0, 125.0)
        axes.spines[["top", "right"]].set_visible(False)
        if number == 0:
            axes.set_ylabel("mobility of the tissue that is left, %")
            figure.legend(
                *axes.get_legend_handles_labels(), ncol=6, fontsize=9, frameon=False, loc="center", bbox_to_anchor=(0.5, 0.51)
            )
    for number, view in enumerate(VIEWS):
        _shape(figure.add_subplot(shapes[number]), out / mesh, mesh, *view, labelled=number == 0)
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=110)
    print(target)


def _shape(
    axes: Axes,
    out: Path,
    mesh: str,
    resection: str,
    gesture: str,
    axis: int,
    place_mm: float,
    right: int,
    up: int,
    *,
    labelled: bool,
) -> None:
    """A cut of three runs at their end, where the tissue is at rest in the plane, and of the palate in that plane."""
    runs = (
        ("intact", "intact", [], "0.6"),
        (f"{resection}-none", "no flap", surgery(resection, "none"), "black"),
        (f"{resection}-flap-x-6", "flap × 6", surgery(resection, "flap x 6"), "#2171b5"),
    )
    low, high = np.zeros(3), np.zeros(3)
    for folder, label, settings, colour in runs:
        done = computed(gesture, mesh, settings, out / folder.replace(" ", "-"))
        line = 1e3 * section(done.mesh, axis, 1e-3 * place_mm).outline(done.mesh.points + done.displacement)
        if not settings:
            axes.fill(line[:-1, right], line[:-1, up], color="0.93")
            low, high = np.nanmin(line, axis=0), np.nanmax(line, axis=0)
        axes.plot(line[:, right], line[:, up], color=colour, lw=1.8 if settings == [] else 1.3, label=label)
    if axis != Z:
        surface = catalogue.bones("tongue")["palate"].surface
        segments = plane_segments(surface.points[surface.triangles], 1e-3 * place_mm * np.eye(3)[axis], np.eye(3)[axis])
        axes.plot(*(1e3 * segments).transpose(2, 1, 0)[[right, up]], color="#b08d57", lw=0.8, zorder=0)
    axes.set_aspect("equal")
    axes.set_xlim(low[right] - 6.0, high[right] + 6.0)
    axes.set_ylim(low[up] - 4.0, high[up] + 8.0)
    axes.set_xlabel(AXES[right], fontsize=8)
    axes.set_ylabel(AXES[up], fontsize=8)
    where = "" if axis == Y else f", {'xyz'[axis]} = {place_mm:g} mm"
    axes.set_title(f"{resection}, {gesture}: {CUTS[axis]}{where}", fontsize=9)
    axes.tick_params(labelsize=7)
    if labelled:
        axes.legend(fontsize=7, frameon=False, loc="lower left")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=["table", "formants", "search", "picture"])
    parser.add_argument("--mesh", default="medium")
    parser.add_argument("--only", type=int, default=None, help="the number of a search, from 0")
    parser.add_argument("--out", type=Path, default=ROOT / "outputs" / "glossectomy")
    parser.add_argument("--picture", type=Path, default=ROOT / "docs" / "pictures" / "glossectomy.png")
    arguments = parser.parse_args()
    if arguments.what == "table":
        table(arguments.mesh, arguments.out)
    elif arguments.what == "formants":
        formants(arguments.mesh, arguments.out)
    elif arguments.what == "search":
        for search in SEARCHES if arguments.only is None else SEARCHES[arguments.only :][:1]:
            looked_for(search, arguments.out, arguments.mesh)
    else:
        picture(arguments.mesh, arguments.out, arguments.picture)


if __name__ == "__main__":
    main()
