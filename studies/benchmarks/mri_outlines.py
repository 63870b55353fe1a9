"""The mouth of the model over the midsagittal outlines of 28 speakers: the pictures and the tables of docs/studies/mouth.md.

    python studies/benchmarks/mri_outlines.py DATA OUT [--page docs]

DATA is the folder ``vocal-tract-41-speakers`` with the mean outlines of Serrurier and Neuschaefer-Rube (2023, J. Acoust. Soc. Am.
153:1867), which are not in the repository. OUT receives the runs and, without ``--page``, the pictures.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from elements import table
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

import explicitfe
from explicitfe.app.view.bones import bone_loops, fill_bones
from explicitfe.app.view.outline import outline_mm
from explicitfe.app.view.palette import COLOURS, new_figure, plain, save
from explicitfe.fem.mesh.hexmesh import FACES, free_faces
from explicitfe.results.files import Result, open_result
from explicitfe.results.measure.bodies import tongue_of
from explicitfe.results.measure.sections import X, Y, Z, cut_surface
from explicitfe.results.measure.steps import step_at

# Name of the posture: scenario, and the time in s; None: the end.
POSTURES = {"rest": ("alveolar-t", 0.0), "[i]": ("vowel-i-palatal", None), "[a]": ("vowel-a", None),
            "[u]": ("vowel-u", None), "[t]": ("alveolar-t", 0.14), "[k]": ("velar-k", 0.14)}  # fmt: skip
UP_MM = 1.0  # the lower edge of the upper incisors is at a height of 100 mm in the data and of 101 mm in the model
COMPARED = {"tongue": "tract", "palate-velum": "hard-palate", "pharynx-wall": "pharynx-wall"}  # by the label of their points
DRAWN = (*COMPARED, "epiglottis-larynx-front", "mandible")
RANGE_PERCENT, ROUNDING = (5.0, 95.0), 1e-9  # a normal through the end of two segments misses neither by rounding
FURTHEST_MM, LEAST_COSINE = 18.0, 0.5  # a crossing further along a normal, or of a line in another direction, is another place
PLACES = ("tip", "blade", "front", "dorsum", "back", "root", "base")
CORONAL_MM = (66.0, 78.0, 102.0)
SIDE_SHOWN_MM, CORONAL_SHOWN_MM = ((41.0, 147.0), (42.0, 137.0)), ((-37.0, 37.0), (48.0, 134.0))
OURS = {"tongue": COLOURS[0], "velum": COLOURS[2]}
OUTSIDE, EACH, MEAN, RANGE, COLOURS_KEPT = COLOURS[1], "#C9A9A3", "#8C4A40", "#F6CFC4", 128
MARK, END = "<!-- mri-outlines -->", "<!-- end mri-outlines -->"
Posture = tuple[Result, int, np.ndarray]  # with the number of a step, and the midsagittal outline (m, 2) mm of its tongue


class Band(NamedTuple):
    """The range of lines around their mean (k, 2) mm: ``low``, ``high`` (k,) mm along its unit normals (k, 2) to the left."""

    mean: np.ndarray
    normal: np.ndarray
    low: np.ndarray
    high: np.ndarray


def crossings(mean: np.ndarray, normal: np.ndarray, line: np.ndarray) -> np.ndarray:
    """The nearest crossing of a line (m, 2) with each normal of a mean line (k, 2), (k,) mm along the normal; NaN: none."""
    start, along = line[None, :-1] - mean[:, None], np.diff(line, axis=0)[None]
    turn = along[..., 0] * normal[:, 1:] - along[..., 1] * normal[:, :1]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (start[..., 1] * along[..., 0] - start[..., 0] * along[..., 1]) / turn
        share = (start[..., 1] * normal[:, :1] - start[..., 0] * normal[:, 1:]) / turn
    counts = (np.abs(share - 0.5) <= 0.5 + ROUNDING) & (np.abs(distance) <= FURTHEST_MM)
    counts &= turn > LEAST_COSINE * np.linalg.norm(along, axis=2)
    nearest = np.where(counts, np.abs(distance), np.inf).argmin(axis=1)[:, None]
    return np.take_along_axis(np.where(counts, distance, np.nan), nearest, axis=1)[:, 0]


def band_of(lines: np.ndarray) -> Band:
    """The range of lines (n, k, 2) mm, the percentiles of ``RANGE_PERCENT``, along the normals of their mean."""
    mean = lines.mean(axis=0)
    along = np.gradient(mean, axis=0, edge_order=2)
    normal = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1, keepdims=True)
    return Band(mean, normal, *np.nanpercentile([crossings(mean, normal, line) for line in lines], RANGE_PERCENT, axis=0))


def outside(band: Band, line: np.ndarray) -> np.ndarray:
    """How far a line (m, 2) lies outside of a band, (k,) mm: 0 within, positive to the left of it, NaN without a crossing."""
    at = crossings(band.mean, band.normal, line)
    return np.maximum(at - band.high, 0.0) - np.maximum(band.low - at, 0.0)


def clockwise(loop: np.ndarray) -> np.ndarray:
    """A closed line (m, 2) in the direction that has its inside on the right."""
    x, z = loop.T
    return loop[::-1] if np.nansum(x[:-1] * z[1:] - x[1:] * z[:-1]) > 0.0 else loop


def cell(off: np.ndarray) -> str:
    """The largest distance outside of the range, with its sign, and the share of places outside, of those with a crossing."""
    off = off[np.isfinite(off)]
    largest = f"{max(off, key=abs, default=0.0):+.1f} ({100.0 * np.mean(off != 0.0):.0f} %)" if len(off) else "no crossing"
    return "within" if largest[1:4] == "0.0" else largest.replace("-", "−")


def tables(bands: dict[str, Band], postures: dict[str, Posture]) -> str:
    """Tongues, at the places of the mean that are nearest to each named point of the tongue at rest, and two bones."""
    band, (at_rest, step, _) = bands["tongue"], postures["rest"]
    points = np.array([1e3 * at_rest.mesh.named_points[place].position[0, [X, Z]] for place in PLACES])
    place = np.linalg.norm(band.mean[:, None] - points, axis=2).argmin(axis=1)
    off = {name: outside(band, outline) for name, (_, _, outline) in postures.items()}
    rows = [[name, *(cell(each[place == number]) for number in range(len(PLACES)))] for name, each in off.items()]
    for part, name in {"palate-velum": "palate", "pharynx-wall": "pharynx"}.items():
        loop = bone_loops(at_rest.placed_bones(step)[name], np.zeros(3), np.eye(3)[Y])[0]
        what = cell(outside(bands[part], clockwise(np.concatenate([loop, loop[:1]])[:, [X, Z]])))
        rows.append([COMPARED[part].replace("-", " "), what, *[""] * (len(PLACES) - 1)])
    return table(["", *PLACES], rows)


def read_speakers(folder: Path) -> tuple[dict[str, np.ndarray], dict[str, Band]]:
    """Outlines (speakers, k, 2) mm in the frame of the model by part, tissue on their right, and the ranges of those compared."""
    files = sorted(folder.glob("speaker-*.csv"))
    if not files:
        raise SystemExit(f"{folder} is absent or has no speaker-*.csv; the source is github.com/tonioser/VTMorphologicalModel.")
    speakers = [list(csv.DictReader(path.read_text(encoding="utf-8").splitlines())) for path in files]
    lines, bands = {}, {}
    for part in DRAWN:
        rows = [[row for row in speaker if row["part"] == part][:: -1 if part == "palate-velum" else 1] for speaker in speakers]
        lines[part] = np.array([[(float(row["back_mm"]), float(row["up_mm"]) + UP_MM) for row in each] for each in rows])
        if part in COMPARED:
            compared = lines[part][:, [row["authors_label"] == COMPARED[part] for row in rows[0]]]
            if part == "tongue":  # from the tip to 6 mm before the end: normals cross at the hollow underside and the vallecula
                compared = compared[:, compared.mean(axis=0)[:, 0].argmin() : -10]
            bands[part] = band_of(compared)
    return lines, bands


def cut_mm(result: Result, step: int, axis: int, at_mm: float) -> dict[str, np.ndarray]:
    """Outlines (m, 3) mm of the tongue and of a deformable velum, as far as they are in a plane that does not move with them."""
    now, (element, face) = result.mesh.points + result.displacement(step), free_faces(result.mesh.hexes)
    faces, tongue_nodes = result.mesh.hexes[element[:, None], FACES[face]], len(tongue_of(result, step)[1])
    own = {"tongue": faces[:, 0] < tongue_nodes, "velum": faces[:, 0] >= tongue_nodes}
    cuts = {name: cut_surface(faces[each], now[:, axis] - 1e-3 * at_mm) for name, each in own.items()}
    return {name: outline_mm(result, cut, now) for name, cut in cuts.items() if cut.loops}


def draw_cut(axes: Axes, result: Result, step: int, axis: int, at_mm: float) -> None:
    """The cut of tongue, bones and further bodies by a plane."""
    across, shown = (X, SIDE_SHOWN_MM) if axis == Y else (Y, CORONAL_SHOWN_MM)
    fill_bones(axes, result, step, 1e-3 * at_mm * np.eye(3)[axis], np.eye(3)[axis], across, label=None)
    for patch in axes.patches:
        patch.set(linewidth=1.5, label="bones of the model")
    for name, line in cut_mm(result, step, axis, at_mm).items():
        axes.plot(line[:, across], line[:, Z], color=OURS[name], lw=2.2, zorder=4, label=f"{name} of the model")
    axes.set(xlim=shown[0], ylim=shown[1], aspect="equal")
    plain(axes)


def draw_midsagittal(path: Path, postures: dict[str, Posture], lines: dict[str, np.ndarray], band: Band) -> None:
    """Six postures over the outlines of all speakers; the parts of the tongue outside of their range stand out."""
    figure = new_figure(10.0, 7.1, 144)
    low, high = (band.mean + side[:, None] * band.normal for side in (band.low, band.high))
    for axes, (name, (result, step, outline)) in zip(figure.subplots(2, 3, sharey=True).flat, postures.items(), strict=True):
        draw_cut(axes, result, step, Y, 0.0)
        axes.fill(*np.concatenate([low, high[::-1]]).T, color=RANGE, lw=0.0, zorder=0.6, label="tongues, 5 to 95 %")
        for part in lines.values():
            axes.plot(*part.transpose(2, 1, 0), color=EACH, lw=0.35, zorder=0.7, label="28 speakers, means over sounds")
            axes.plot(*part.mean(axis=0).T, color=MEAN, lw=1.0, zorder=0.8, label="mean of the speakers")
        off = outside(band, outline)
        away = np.where(off == 0.0, np.nan, np.where(off > 0.0, band.high, band.low) + off)[:, None]
        axes.plot(*(band.mean + away * band.normal).T, ".", color=OUTSIDE, ms=4.5, zorder=5, label="outside of 5 to 95 %")
        axes.set(title=f"{name}, {1e3 * result.times[step]:.0f} ms", xlabel="front  ←   x (mm)   →  back", ylabel="z, up (mm)")
    finish(figure, path)


def draw_coronal(path: Path, postures: dict[str, Posture], lines: dict[str, np.ndarray]) -> None:
    """Three coronal cuts of six postures, with the heights of the speakers' tongues and palates in the midline."""
    panels = new_figure(10.0, 5.9, 144).subplots(len(CORONAL_MM), len(postures), sharex=True, sharey=True)
    for (row, column), axes in np.ndenumerate(panels):
        name, at_mm = list(postures)[column], CORONAL_MM[row]
        draw_cut(axes, *postures[name][:2], X, at_mm)
        for part, y_mm, colour, end in (("tongue", -2.0, OUTSIDE, np.max), ("palate-velum", 2.0, MEAN, np.min)):
            heights = np.percentile([end(each[np.abs(each[:, 0] - at_mm) < 1.0, 1]) for each in lines[part]], RANGE_PERCENT)
            label = f"speakers' {part.partition('-')[0]}s in the midline, 5 to 95 %"
            axes.plot([y_mm, y_mm], heights, color=colour, lw=2.5, zorder=5, label=label)
        axes.set(title="" if row else name, xlabel="left  ←  y  →  right", ylabel=f"x = {at_mm:.0f} mm\nz, up (mm)")
    finish(panels[0, 0].figure, path)


def finish(figure: Figure, path: Path) -> None:
    """Keep the outer labels, add one legend to all panels, and save."""
    handles: dict[str, Any] = {}
    for axes in figure.axes:
        handles |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
        axes.label_outer()
    figure.legend(handles.values(), handles, loc="outside lower center", ncols=4, frameon=False, fontsize=8.5)
    save(figure, path)
    Image.open(path).convert("RGB").quantize(COLOURS_KEPT, kmeans=4).save(path, optimize=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path, help="folder of the outlines")
    parser.add_argument("out", type=Path, help="folder of the runs, and of the pictures without --page")
    parser.add_argument("--page", type=Path, help="folder of the pages: put in table and pictures")
    arguments = parser.parse_args()
    lines, bands = read_speakers(arguments.data)
    postures, results = dict[str, Posture](), dict[str, Result]()
    for name, (scenario, time_s) in POSTURES.items():
        if scenario not in results:
            path, medium = Path("scenarios") / f"{scenario}.toml", {"model.resolution": "medium"}
            results[scenario] = open_result(str(explicitfe.run(path, arguments.out, settings=medium, overwrite=True)["result"]))
        result, step = results[scenario], step_at(results[scenario], time_s)
        postures[name] = result, step, clockwise(cut_mm(result, step, Y, 0.0)["tongue"][:, [X, Z]])
    print(written := tables(bands, postures))
    pictures = arguments.page / "pictures" if arguments.page else arguments.out
    draw_midsagittal(pictures / "mri-midsagittal.png", postures, lines, bands["tongue"])
    draw_coronal(pictures / "mri-coronal.png", postures, lines)
    if arguments.page:
        page = arguments.page / "studies" / "mouth.md"
        before, _, after = page.read_text(encoding="utf-8").partition(MARK)
        page.write_text(f"{before}{MARK}\n\n{written}\n\n{END}{after.partition(END)[2]}", encoding="utf-8")


if __name__ == "__main__":
    main()
