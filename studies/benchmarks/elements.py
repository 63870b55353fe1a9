"""How good the three elements are, and what they cost: the tables of docs/studies/elements.md.

    python studies/benchmarks/elements.py [--only bending panel blocks cantilever cost] [--out docs/studies/elements.md]

Static solutions come from tests/statics.py. About ten minutes on one core, most of it for the fine reference solutions.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import numpy as np  # noqa: E402
from outside_data import SHARED_DATA  # noqa: E402
from statics import MOTIONS, beam_deflection, block_run, cantilever, first_bending, panel_tip, swing, timoshenko  # noqa: E402
from support import block_mesh, model_of  # noqa: E402

from explicitfe.fem.elements import hourglass_stiffness as stiffness  # noqa: E402
from explicitfe.fem.solve.simulation import Simulation  # noqa: E402

ELEMENTS = ("hex8", "hex8-stiffness", "hex8-full")
# What a row shows: the element, and the factor on its hourglass coefficient.
ROWS = {
    "hex8": ("hex8", 1.0),
    "stiffness x 0.2": ("hex8-stiffness", 0.2),
    "stiffness x 1": ("hex8-stiffness", 1.0),
    "stiffness x 5": ("hex8-stiffness", 5.0),
    "full": ("hex8-full", 1.0),
}
REFERENCE = SHARED_DATA / "reference" / "cantilever" / "expl_n12.csv"


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = list(head)
    lines = ["| " + " | ".join(cells) + " |" for cells in (head, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(head), *lines[1:]])


def with_factor(label: str, solve: Callable[[str], float]) -> float:
    """``solve(element)`` with the factor of a row."""
    element, factor = ROWS[label]
    stiffness.STIFFNESS_FACTOR = factor
    try:
        return solve(element)
    finally:
        stiffness.STIFFNESS_FACTOR = 1.0


def limit(values: list[float]) -> tuple[float, float]:
    """The limit of three values on meshes each twice as fine, and the order seen: v + c h^p."""
    a, b, c = values[-3:]
    ratio = (b - a) / (c - b)
    return c + (c - b) / (ratio - 1.0), float(np.log2(ratio))


def both_limits(solve: Callable[[str, int], float], meshes: tuple[int, int, int]) -> tuple[float, float, list[float]]:
    """Mean of the limits of hex8 and hex8-full, half their difference, and the orders.

    Where an order is below a half, no limit is in sight: then the value is that of hex8-full on the finest mesh, and the doubt
    is its last change.
    """
    values = [[solve(element, n) for n in meshes] for element in ("hex8", "hex8-full")]
    (a, p), (b, q) = (limit(v) for v in values)
    if not min(p, q) > 0.5:
        return values[1][-1], abs(values[1][-1] - values[1][-2]), [p, q]
    return 0.5 * (a + b), 0.5 * abs(a - b), [p, q]


def bending() -> str:
    shapes = [(L, aspect) for L in (3.0, 6.0) for aspect in (1.0, 0.5)]
    references, lines = {}, []
    for L in (3.0, 6.0):
        for nu in (0.499, 0.4999):
            value, doubt, orders = both_limits(lambda e, n, L=L, nu=nu: beam_deflection(e, L, n, 1.0, nu), (4, 8, 16))
            references[L, nu] = value
            lines.append([
                f"{L:g}", f"{nu:g}", f"{value:.5f}", f"{100 * doubt / value:.3f} %", f"{orders[0]:.2f}, {orders[1]:.2f}",
                f"{value / timoshenko(L, nu):.4f}",
            ])  # fmt: skip
            print(lines[-1], flush=True)
    check, _, _ = both_limits(lambda e, n: beam_deflection(e, 3.0, n, 1.0, 0.499), (6, 12, 24))
    parts = [
        table(("L/H", "Poisson", "converged, m/N", "uncertainty", "orders hex8, full", "ratio to Timoshenko"), lines),
        f"With 6, 12 and 24 elements instead, L/H = 3 at 0.499 converges to {check:.5f} m/N, "
        f"{100 * (check / references[3.0, 0.499] - 1):+.3f} % off.",
    ]
    for nu in (0.499, 0.4999):
        rows = []
        for label in ROWS:
            cells = []
            for L, aspect in shapes:
                for n in (2, 4, 8):
                    w = with_factor(label, lambda e, L=L, n=n, a=aspect, nu=nu: beam_deflection(e, L, n, a, nu))
                    cells.append(f"{100 * (w / references[L, nu] - 1):+.2f}")
            rows.append([label, *cells])
            print(nu, rows[-1], flush=True)
        head = [f"{L:g}:1 {'cubes' if a == 1.0 else 'half'} {n}" for L, a in shapes for n in (2, 4, 8)]
        parts.append(f"Poisson's ratio {nu:g}, error of the tip deflection in %:\n\n" + table(("", *head), rows))
    return "\n\n".join(parts)


def panel() -> str:
    value, doubt, orders = both_limits(lambda e, n: panel_tip(e, n)[0], (16, 32, 64))
    rows = []
    for label in ROWS:
        deflections = [with_factor(label, lambda e, n=n: panel_tip(e, n)[0]) for n in (2, 4, 8, 16, 32)]
        rows.append([label, *(f"{1e3 * w:.3f} ({100 * (w / value - 1):+.1f} %)" for w in deflections)])
        print(rows[-1], flush=True)
    return (
        f"Converged: {1e3 * value:.3f} ± {1e3 * doubt:.3f} mm (limits of hex8 and full from 16, 32 and 64; orders "
        f"{orders[0]:.2f} and {orders[1]:.2f}).\n\n" + table(("", "2 x 2", "4 x 4", "8 x 8", "16 x 16", "32 x 32"), rows)
    )


def blocks() -> str:
    rows, finest = [], []
    for kind in MOTIONS:
        reference, doubt, orders = both_limits(lambda e, n, kind=kind: block_run(kind, e, n).energy, (4, 8, 16))
        finest.append(f"{kind} {1e3 * reference:.3f} mJ ± {100 * doubt / reference:.1f} % ({orders[0]:.2f}, {orders[1]:.2f})")
        print(finest[-1], flush=True)
        for element in ELEMENTS:
            for n in (3, 4, 8) if element == "hex8" else (4, 8):
                r = block_run(kind, element, n)
                rows.append([
                    kind, element, str(n), f"{1e3 * r.energy:.3f}", f"{100 * (r.energy / reference - 1):+.1f}",
                    f"{100 * r.hourglass:.1f} / {100 * r.hourglass_largest:.1f}", f"{r.smallest_J:.3f}",
                    f"{r.folded} of {r.elements}",
                    f"{r.balance:.0e}", f"{1e3 * r.end_displacement:.3f}", "inverted" if r.status else "no",
                ])  # fmt: skip
                print(rows[-1], flush=True)
    head = (
        "motion", "element", "n", "energy, mJ", "error, %", "hourglass share, %", "min J", "inverted elements", "balance",
        "end, mm", "stopped",
    )  # fmt: skip
    return (
        "Reference energies: the mean of the limits of hex8 and full from n = 4, 8 and 16, half their difference (and their "
        "orders); where these are below a half, full with n = 16 and its change from n = 8: "
        + "; ".join(finest)
        + ".\n\n"
        + table(head, rows)
    )


def dynamic() -> str:
    at = (30, 60, 90, 120)
    rows, swings = [], []
    if REFERENCE.is_file():
        data = np.genfromtxt(REFERENCE, delimiter=",", names=True)
        exact = np.interp(at, data["t_ms"], data["uz_face_mean_mm"])
        rows.append(["reference", "12", *(f"{x:.3f}" for x in exact), ""])
    else:
        print(f"{REFERENCE} is missing: errors against the reference are left out (nan)", flush=True)
        exact = np.full(4, np.nan)
    for label, n in (*((label, 4) for label in ROWS), ("hex8", 8), ("full", 8)):
        t, w = with_factor(label, lambda e, n=n: cantilever(e, n, 0.121))
        u = np.interp(at, 1e3 * t, 1e3 * w)
        rows.append([label, str(n), *(f"{x:.3f} ({100 * (x / y - 1):+.2f} %)" for x, y in zip(u, exact, strict=True))])
        off = np.nan
        if REFERENCE.is_file():
            times = np.arange(30, 121)
            ref = np.interp(times, data["t_ms"], data["uz_face_mean_mm"])
            off = np.abs(np.interp(times, 1e3 * t, 1e3 * w) / ref - 1).max()
        rows[-1].append(f"{100 * off:.2f}")
        print(rows[-1], flush=True)
    for force in (0.02, 0.002):
        for label, n in (("full", 12), ("full", 8), *((label, 4) for label in ROWS), ("hex8", 8)):
            f, peak = swing(*with_factor(label, lambda e, n=n, force=force: cantilever(e, n, 2.2, force)))
            if n == 12:
                first = f, peak
            swings.append([
                f"{force:g}", label, str(n),
                f"{f:.4f} ({100 * (f / first[0] - 1):+.2f} %)" if np.isfinite(f) else "does not swing back",
                f"{1e3 * peak:.3f} ({100 * (peak / first[1] - 1):+.2f} %)",
            ])  # fmt: skip
            print(swings[-1], flush=True)
    value, doubt, orders = both_limits(first_bending, (4, 8, 16))
    modes = []
    for label in ROWS:
        frequencies = [with_factor(label, lambda e, n=n: first_bending(e, n)) for n in (2, 4, 8)]
        modes.append([label, *(f"{f:.4f} ({100 * (f / value - 1):+.2f} %)" for f in frequencies)])
        print(modes[-1], flush=True)
    return (
        table(("", "elements across", *(f"{t} ms" for t in at), "largest, 30 to 120 ms, %"), rows)
        + "\n\nThe load held for 2.2 s, also with a tenth of it; frequency from the passes of half the first peak, peak of the "
        "first swing; against hex8-full with 12 elements across:\n\n"
        + table(("load, N", "", "elements across", "frequency, 1/s", "peak, mm"), swings)
        + f"\n\nLowest bending frequency of small vibrations; converged {value:.4f} 1/s ± {100 * doubt / value:.2f} % (limits of "
        f"hex8 and full from 4, 8 and 16 elements across; orders {orders[0]:.2f} and {orders[1]:.2f}):\n\n"
        + table(("", "2 across", "4", "8"), modes)
    )


def costs(names: Iterable[str], cells: tuple[int, int, int], turns: int = 5) -> dict[str, tuple[float, float]]:
    """Nanoseconds per step and element, the fastest of some turns, and stable step [s] at rest of the elements named."""
    simulations = {}
    for element in names:
        mesh = block_mesh(cells, 0.002, distort=0.1)
        velocity = np.random.default_rng(0).normal(0.0, 1e-3, mesh.points.shape)
        simulations[element] = Simulation(model_of(mesh, held=("x0",), element=element), velocity=velocity)
        simulations[element].compile()
        simulations[element].start(0.5 * simulations[element].stable_bound()[0])
    count = int(np.prod(cells))
    steps = max(10, 600_000 // count)
    best = dict.fromkeys(simulations, np.inf)
    for _ in range(turns):
        for element, simulation in simulations.items():
            begin = time.perf_counter()
            assert simulation.advance(steps, simulation.dt_s)
            best[element] = min(best[element], time.perf_counter() - begin)
    return {
        element: (1e9 * best[element] / steps / count, simulation.stable_limit(60)) for element, simulation in simulations.items()
    }


def cost() -> str:
    rows = []
    for cells in ((10, 10, 10), (31, 31, 31)):
        every = costs(ELEMENTS, cells)
        ns_of_hex8, step_of_hex8 = every["hex8"]
        for element, (ns, step) in every.items():
            count = f"{int(np.prod(cells)):,}".replace(",", " ")
            rows.append([count, element, f"{ns:.0f}", f"{ns / ns_of_hex8:.2f}", f"{step / step_of_hex8:.3f}"])
            print(rows[-1], flush=True)
    return table(("elements", "", "ns per step and element", "ratio to hex8", "stable step, ratio to hex8"), rows)


SECTIONS = {"bending": bending, "panel": panel, "blocks": blocks, "cantilever": dynamic, "cost": cost}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", nargs="*", choices=list(SECTIONS), default=list(SECTIONS))
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "studies" / "elements.md")
    arguments = parser.parse_args()
    text = arguments.out.read_text(encoding="utf-8")
    for name in arguments.only:
        mark, end = f"<!-- {name} -->", f"<!-- end {name} -->"
        before, following = text.split(mark)
        text = before + mark + "\n\n" + SECTIONS[name]() + "\n\n" + end + following.split(end)[1]
        arguments.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
