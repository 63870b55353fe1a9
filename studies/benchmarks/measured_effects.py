"""What effects explain in measured data: tables, and pictures of docs/reference/effects.md.

    python studies/benchmarks/measured_effects.py muscle DATASET [--picture docs/pictures/muscle.png]
    python studies/benchmarks/measured_effects.py silicone DATASET [--picture docs/pictures/silicone.png] [--radii 4.5 5.5]
    python studies/benchmarks/measured_effects.py cycles [--picture docs/pictures/cycles.png]

DATASET is the folder muscle-compression or silicone-indentation, in the format of docs/reference/identify.md. Constants are
fitted to some curves and judged on others.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from effects_fit import EffectsFit, Unknown, Values, fit_effects, series

from explicitfe.fem.effects.material.fibres import Fibres
from explicitfe.fem.effects.material.softening import Softening
from explicitfe.fem.effects.material.viscoelastic import Viscoelastic
from explicitfe.fem.effects.tool.preload import Preload
from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.solve.equilibrium import Relaxation
from explicitfe.fem.solve.load_outcome import Equilibrium
from explicitfe.inverse.measured.curve import Curve
from explicitfe.inverse.measured.read import read_dataset
from explicitfe.inverse.predict.predict import predict_test
from explicitfe.inverse.predict.tissue import EVERY, Constants, Tissue, parse_tissue
from explicitfe.simulate.anatomy.specimen import specimen_model

BLUE, RED, GREY = "#0072B2", "#D55E00", "0.55"
TERMS = {0: (), 1: (20.0,), 2: (3.0, 60.0), 3: (0.7, 10.0, 100.0)}  # starting times, s


def share(measured: np.ndarray, predicted: np.ndarray) -> float:
    """Rms deviation in % of the largest measured value."""
    return float(100.0 * np.sqrt(np.mean((predicted - measured) ** 2)) / np.abs(measured).max())


def tissue(values: Values, terms: int, poisson: float, **tables) -> Tissue:
    """A model from long-term constants and the shares of its relaxing terms, relative to the long-term stress."""
    shares = [values[f"s{k}"] for k in range(terms)]
    sudden = 1.0 + sum(shares)
    constants = Constants(C10_Pa=sudden * values["C10"], C20_Pa=sudden * values["C20"])
    model = Tissue(poisson=poisson, constants={EVERY: constants}, **tables)
    if "k1" in values:
        model = model.with_effect(Fibres(k1_Pa=sudden * values["k1"], k2=values["k2"]))
    return model.with_effect(series(shares, [values[f"t{k}"] for k in range(terms)])) if terms else model


def prony(terms: int, longest: float, times: Sequence[float] | None = None) -> dict[str, Unknown]:
    unknowns: dict[str, Unknown] = {}
    for k, tau in enumerate(times or TERMS[terms]):
        unknowns |= {f"s{k}": Unknown(1e-3, 100.0, 0.5), f"t{k}": Unknown(0.05, longest, tau)}
    return unknowns


# ---- muscle ----


def muscle(dataset: Path, picture: Path | None) -> None:
    curves = {c.id: c for c in read_dataset(dataset).regrouped("direction").curves}
    one = lambda c, model: predict_test([c], model)[0].values  # noqa: E731
    every = lambda cs, model: [one(c, model) for c in cs]  # noqa: E731
    error = lambda name, model: share(curves[name].columns["nominal_stress_Pa"], one(curves[name], model))  # noqa: E731
    directions = ("fibre", "cross-fibre")
    held = {d: f"{d}-max-0.3-rate-0.05" for d in directions}
    print("| law | fitted to | fitted curves (0.005, 0.01 /s) | held out 0.05 /s | held out, strain 0.1 | 0.2 | at a bound |")
    print("|---|---|---|---|---|---|---|")
    fits: dict[tuple, EffectsFit] = {}
    for which in (directions[:1], directions[1:], directions):
        train = [curves[f"{d}-max-0.3-rate-{rate}"] for d in which for rate in ("0.005", "0.01")]
        for fibres in (False, True) if len(which) == 2 else (False,):
            for terms in TERMS:
                unknowns = {"C10": Unknown(1.0, 1e4, 300.0), "C20": Unknown(0.1, 1e5, 300.0)} | prony(terms, 2000.0)
                if fibres:
                    unknowns |= {"k1": Unknown(0.1, 1e5, 300.0), "k2": Unknown(0.01, 50.0, 1.0)}
                fit = fit_effects(train, unknowns, partial(tissue, terms=terms, poisson=0.499), every)
                fits[which, fibres, terms] = fit
                cells = [", ".join(f"{100.0 * e:.1f}" for e in fit.nrmse.values())]
                for names in (held.values(), *([f"{d}-max-{s}-rate-0.01" for d in directions] for s in ("0.1", "0.2"))):
                    chosen = [name for name in names if curves[name].conditions["direction"] in which]
                    cells.append(", ".join(f"{error(name, fit.model):.1f}" for name in chosen))
                law = "Yeoh" + " + fibres" * fibres + (f" + {terms} term{'s' * (terms > 1)}" if terms else "")
                print(f"| {law} | {' and '.join(which)} | {' | '.join(cells)} | {', '.join(fit.at_bound) or '-'} |", flush=True)
    for key in ((directions[:1], False, 2), (directions[1:], False, 2), (directions, True, 2)):
        print(f"\n{', '.join(key[0])}:\n{fits[key].model.text}")
    if picture is None:
        return
    import matplotlib.pyplot as plt

    figure, rows = plt.subplots(2, 2, figsize=(10.0, 6.6), layout="constrained")
    for column, d in zip(rows.T, directions, strict=True):
        curve = curves[held[d]]
        order = np.unique(np.concatenate([np.linspace(0.0, 12.0, 400), np.geomspace(12.0, curve.time_s[-1], 100)]))
        stretch = 1.0 - np.minimum(0.05 * order, 0.3)
        smooth = replace(curve, time_s=order, columns={"stretch": stretch, "nominal_stress_Pa": order})
        laws = (
            ("Yeoh, elastic", fits[(d,), False, 0], {"color": GREY, "ls": "-"}),
            ("Yeoh + 2 relaxing terms", fits[(d,), False, 2], {"color": BLUE, "ls": "-"}),
            ("one law for both directions: + fibres", fits[directions, True, 2], {"color": RED, "ls": "--"}),
        )
        for axes, until in zip(column, (12.0, None), strict=True):
            axes.plot(
                curve.time_s, -1e-3 * curve.columns["nominal_stress_Pa"], "o", ms=3.5, color="black", label="measured (held out)"
            )
            for label, fit, style in laws:
                off = error(curve.id, fit.model)
                axes.plot(order, -1e-3 * one(smooth, fit.model), lw=1.6, label=f"{label} ({off:.1f} %)", **style)
            axes.set_xlim(0.0, until)
            axes.set_xlabel("time (s)")
            axes.set_ylabel("compression, nominal stress (kPa)")
            _plain(axes)
        name = {"fibre": "along the fibres", "cross-fibre": "across the fibres"}[d]
        column[0].set_title(f"{name}, 0.05 /s: the ramp", loc="left", fontsize=10)
        column[1].set_title("the whole hold", loc="left", fontsize=10)
        column[1].legend(frameon=False, fontsize=8)
        for axes in column:
            axes.set_ylim(0.0, 4.7)
    figure.savefig(picture, dpi=160)


# ---- silicone ----

SILICONE_POISSON = 0.49
FITTED = ("p002-cycle-9", "p002-cycle-11")
DEEPEST_M = 6.0e-3
QUICK = {"refinement": 0.6, "density": 0.7, "tolerance": 5e-4}


def _one(job: tuple[Curve, str, dict]) -> np.ndarray:
    curve, text, how = job
    return predict_test([curve], parse_tissue(text), **how)[0].values


def silicone(dataset: Path, picture: Path | None, radii: Sequence[float]) -> None:
    curves = {c.id: _cut(c) for c in read_dataset(dataset).curves if not c.defect}
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:

        def answer(asked: Sequence[Curve], model: Tissue, **how) -> list[np.ndarray]:
            begin = time.perf_counter()
            predictions = list(pool.map(_one, [(model_curve(c, model), model.text, how) for c in asked]))
            answer.seconds += time.perf_counter() - begin
            return predictions

        answer.seconds = 0.0
        fitted = [curves[name] for name in FITTED]
        results: dict[tuple[float, int], tuple[EffectsFit, dict[str, float]]] = {}
        shown: dict[tuple[int, str], np.ndarray] = {}
        for radius in (5.0, *radii):
            for terms in (0, 2):
                make = partial(_silicone_tissue, terms=terms, radius=radius)
                unknowns = {"C10": Unknown(100.0, 1e5, 1800.0), "C20": Unknown(1.0, 1e5, 300.0)}
                unknowns |= prony(terms, 500.0, [1.5, 20.0][:terms])
                if radius != 5.0:  # near those of the radius that is assumed
                    near = results[5.0, terms][0].values
                    unknowns = {
                        k: replace(u, start=float(np.clip(near[k], 1.01 * u.low, 0.99 * u.high))) for k, u in unknowns.items()
                    }
                fit = fit_effects(fitted, unknowns, make, partial(answer, **QUICK), starts=1, most=7, tolerance=1e-4)
                names = [name for name in curves if curves[name].constants == "P002" and (radius == 5.0 or "cycle" in name)]
                predicted = answer([curves[name] for name in names], fit.model)
                errors = {n: share(curves[n].force_N, y) for n, y in zip(names, predicted, strict=True)}
                scaled = {n: _scaled(curves[n].force_N, y) for n, y in zip(names, predicted, strict=True)}
                results[radius, terms] = fit, errors
                if radius == 5.0:
                    shown |= {(terms, n): y for n, y in zip(names, predicted, strict=True)}
                print(f"\nradius {radius} mm, {terms} terms, {answer.seconds:.0f} s so far, bounds {fit.at_bound}")
                for name, off in errors.items():
                    print(f"| {name} | {off:.1f} | {scaled[name][1]:.1f} (x {scaled[name][0]:.2f}) |")
                print(fit.model.text, flush=True)
    if picture is not None:
        _draw_silicone(picture, curves, shown, {t: results[5.0, t][1] for t in (0, 2)})


def _scaled(measured: np.ndarray, predicted: np.ndarray) -> tuple[float, float]:
    """The factor that brings a prediction closest to the curve, as another C10 would, and the remaining deviation in %."""
    factor = float(predicted @ measured / (predicted @ predicted))
    return factor, share(measured, factor * predicted)


def model_curve(curve: Curve, model: Tissue) -> Curve:
    """The curve with the tool's radius of the model."""
    return replace(curve, tool=curve.tool.model_copy(update=model.tool))


def _silicone_tissue(values: Values, terms: int, radius: float) -> Tissue:
    """The tissue; its preload is replaced by the measured one of each curve."""
    return tissue(values, terms, SILICONE_POISSON, tool={"radius_mm": radius}).with_effect(Preload(force_N=0.01))


def _cut(curve: Curve) -> Curve:
    """A curve, or its ramp down to 6 mm where it goes deeper."""
    depth_m = curve.displacement_m
    if depth_m.max() <= 1.001 * DEEPEST_M:
        return curve
    rows = int(np.argmax(depth_m > DEEPEST_M))
    return replace(curve, time_s=curve.time_s[:rows], columns={k: v[:rows] for k, v in curve.columns.items()})


def _draw_silicone(picture: Path, curves: dict[str, Curve], shown: dict, errors: dict[int, dict[str, float]]) -> None:
    import matplotlib.pyplot as plt

    figure, rows = plt.subplots(2, 2, figsize=(10.0, 6.6), layout="constrained")
    cases = {"p002-cycle-4": "another depth, 6 mm", "p002-cycle-13": "another repeat, 5 mm"}
    for column, (name, what) in zip(rows.T, cases.items(), strict=True):
        curve = curves[name]
        x = 1e3 * curve.displacement_m
        for axes, abscissa, label in ((column[0], curve.time_s, "time (s)"), (column[1], x, "displacement (mm)")):
            axes.plot(abscissa, curve.force_N, color="black", lw=3.0, alpha=0.35, label="measured (held out)")
            axes.plot(abscissa, shown[0, name], color=GREY, lw=1.4, ls="--", label=f"Yeoh, elastic ({errors[0][name]:.1f} %)")
            axes.plot(abscissa, shown[2, name], color=BLUE, lw=1.4, label=f"Yeoh + 2 relaxing terms ({errors[2][name]:.1f} %)")
            axes.set_xlabel(label)
            axes.set_ylabel("force (N)")
            axes.set_ylim(-0.02, 1.15 * curve.force_N.max())
            _plain(axes)
        column[0].set_title(what, loc="left", fontsize=10)
        column[1].legend(frameon=False, fontsize=8, loc="upper left")
    figure.savefig(picture, dpi=160)


# ---- cycles ----


def cycles(picture: Path | None) -> None:
    """The paper's protocol: five cycles of eight force steps up and down, each followed by a dwell, with two causes of a loop."""
    cases = {
        "softening (1/r 0.5, m 5 Pa)": ((Softening(inverse_r=0.5, m_Pa=5.0, beta=0.1),), 10.0),
        "slow relaxation (g 0.3, τ 60 s; dwell 10 s)": ((Viscoelastic(g=(0.3,), tau_s=(60.0,)),), 10.0),
    }
    steps = [round(0.1 * k, 1) for k in (*range(1, 9), *range(7, -1, -1))]
    courses = {}
    for name, (effects, dwell) in cases.items():
        begin = time.perf_counter()
        specimen = SpecimenTable(radius_mm=35.0, height_mm=20.0, material="gerard-2005")
        body = Relaxation(specimen_model(specimen, ToolTable(shape="flat-cylinder", radius_mm=14.0, edge_radius_mm=2.0), effects))
        body.compile()
        body.settle()
        now, course = 0.0, [(0, 0.0, 0.0)]
        for cycle in range(5):
            for force in steps:
                # the step takes 1 s, then it dwells
                for after in (1.0, dwell):
                    now += after
                    reached = body.press(force, at_s=now)
                    assert isinstance(reached, Equilibrium), reached
                course.append((cycle, force, 1e3 * reached.displacement_m))
        courses[name] = np.array(course)
        rows = courses[name]
        for cycle in range(5):
            one = rows[rows[:, 0] == cycle]
            loop = _loop(rows[_of_cycle(rows, cycle)])
            print(
                f"{name}: cycle {cycle + 1}: at 0.8 N {one[one[:, 1] == 0.8, 2][0]:.3f} mm, at 0.4 N up, down "
                f"{', '.join(f'{d:.3f}' for d in one[one[:, 1] == 0.4, 2])} mm, left {one[-1, 2]:.3f} mm, loop {loop:.3f} mJ"
            )
        print(f"{time.perf_counter() - begin:.0f} s", flush=True)
    if picture is None:
        return
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10.0, 4.4), sharey=True, sharex=True, layout="constrained")
    colours = plt.get_cmap("viridis")(np.linspace(0.0, 0.85, 5))
    for ax, (name, rows) in zip(axes, courses.items(), strict=True):
        for cycle in range(5):
            where = _of_cycle(rows, cycle)
            ax.plot(rows[where, 2], rows[where, 1], "o-", ms=3.0, lw=1.2, color=colours[cycle], label=f"cycle {cycle + 1}")
        ax.set_title(name, loc="left", fontsize=10)
        ax.set_xlabel("displacement (mm)")
        ax.legend(frameon=False, fontsize=8)
        _plain(ax)
    axes[0].set_ylabel("force (N)")
    figure.savefig(picture, dpi=160)


def _of_cycle(rows: np.ndarray, cycle: int) -> np.ndarray:
    """Rows of a cycle, from the end of the last cycle on."""
    where = np.flatnonzero(rows[:, 0] == cycle)
    return where if cycle == 0 else np.concatenate([[where[0] - 1], where])


def _loop(rows: np.ndarray) -> float:
    """Area of a cycle [mJ]: the work of loading less that of unloading."""
    return float(np.sum(0.5 * (rows[1:, 1] + rows[:-1, 1]) * np.diff(rows[:, 2])))


def _plain(axes) -> None:
    axes.grid(color="0.9", lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("study", choices=["muscle", "silicone", "cycles"])
    parser.add_argument("dataset", type=Path, nargs="?")
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--radii", type=float, nargs="*", default=[])
    options = parser.parse_args()
    if options.study == "cycles":
        cycles(options.picture)
    elif options.dataset is None:
        parser.error("which dataset?")
    elif options.study == "muscle":
        muscle(options.dataset, options.picture)
    else:
        silicone(options.dataset, options.picture, options.radii)


if __name__ == "__main__":
    main()
