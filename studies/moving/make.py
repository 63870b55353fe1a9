"""Sealed cases of a released cantilever, made by a solver that shares nothing with explicitfe.

    python -m studies.moving.make OUT --count 40 --seed 1

    python -m studies.moving.make scenarios/datasets/simulated-beam --one load-mass --strength 1.0 --seed 5

makes folders OUT/case-NN, each a dataset of markers on a soft beam: own weight and two loads at the free end. Every case hides
one effect that its scenario lacks, or none. The truth is in OUT/truth.json, which the judge alone reads. With ``--one`` OUT is
a single dataset, such as the one that comes with the program. The motion is that of a geometrically exact beam
(geometrically_exact_beam.py).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from studies.moving.geometrically_exact_beam import Beam, Marker, simulate

G_M_S2 = 9.81
RATE_HZ = 200.0
REST_ROWS = 12
# An effect that changes the markers by less, relative to their largest displacement, is drawn again: without repeats the loop
# assumes that a model errs by 1 %.
LEAST_CHANGE_SHARE, MOST_DRAWS = 0.02, 50
# Hidden cause -> smallest and largest strength, in units given in `truth_of`. Two effects are not hidden, because nothing could
# show them: in the plane of a beam a tilt of gravity acts by one minus the cosine of the angle, and drag of the air with the
# coefficient of a bluff body, 1 to 2, changes these beams by less than 0.1 %.
STRENGTHS = {
    "none": (0.0, 0.0),
    "viscoelastic": (0.08, 0.35),
    "viscosity": (0.001, 0.004),
    "damping": (2.0, 12.0),
    "load-mass": (0.6, 1.0),
    "marker-mass": (0.01, 0.04),
    "density": (1.08, 1.25),
    "clamp-rotation": (0.05, 0.2),
    "clamp-translation": (0.03, 0.1),
    "release": (0.015, 0.05),
    "load-delay": (0.02, 0.06),
    "air-drag-linear": (2.0, 10.0),
    "dimension-z": (1.04, 1.1),
    "dimension-x": (1.03, 1.07),
    "camera-lag": (0.006, 0.02),
    "stand-off": (2.5, 6.0),
    "nonlinear-law": (1.5, 5.0),
}
# Forms of one cause: the verdict names the cause.
CAUSE = {
    "viscosity": "viscoelastic",
    "clamp-rotation": "clamp-compliance",
    "clamp-translation": "clamp-compliance",
    "air-drag-linear": "air-drag",
    "dimension-z": "dimension",
    "dimension-x": "dimension",
}


@dataclass(frozen=True)
class Body:
    """What a scenario states: lengths in m, Pa, kg/m^3."""

    length: float
    width: float
    height: float
    C10: float
    density: float
    alpha: float
    noise: float
    loads: tuple[float, ...]
    stand_off: float

    @property
    def mass(self) -> float:
        return self.length * self.width * self.height * self.density


def draw(rng: np.random.Generator) -> Body:
    length = rng.uniform(0.08, 0.13)
    height = length / rng.uniform(4.5, 7.0)
    width = height * rng.uniform(0.8, 1.4)
    density = rng.uniform(1000.0, 1100.0)
    # softness by the sag under the own weight: 3 to 8 % of the length
    sag = rng.uniform(0.03, 0.08) * length
    E = 12.0 * density * G_M_S2 * length**4 / (8.0 * height**2 * sag)
    mass = length * width * height * density
    loads = tuple(float(x) * mass * G_M_S2 for x in (0.0, rng.uniform(0.1, 0.2), rng.uniform(0.25, 0.4)))
    noise = float(rng.choice([1e-5, 2e-5, 5e-5]))
    return Body(length, width, height, E / 6.0, density, rng.uniform(4.0, 9.0), noise, loads, rng.uniform(0.003, 0.007))


def truth_of(body: Body, kind: str, strength: float, load_N: float) -> tuple[Beam, float, float]:
    """The beam as it is, the lag of its recording [s], and the further stand-off of its markers [m]."""
    b, E = body, 6.0 * body.C10
    I_m4, area = b.width * b.height**3 / 12.0, b.width * b.height
    beam = Beam(
        length_m=b.length,
        width_m=b.width,
        height_m=b.height,
        density_kg_per_m3=b.density,
        c10_pa=b.C10,
        alpha_per_s=b.alpha,
        gravity_z_m_per_s2=-G_M_S2,
        tip_force_z_n=-load_N,
        tip_offset_z_m=0.5 * b.height,
    )
    lag = more = 0.0
    if kind == "viscoelastic":
        duration = 0.7
        beam = replace(beam, c10_pa=b.C10 / (1.0 - strength), prony_g=strength, prony_tau_s=0.06 * duration)
    elif kind == "viscosity":
        beam = replace(beam, beta_s=strength)
    elif kind == "damping":
        beam = replace(beam, alpha_per_s=b.alpha + strength)
    elif kind == "load-mass":
        # the force is a weight: with the inertia of its mass
        beam = replace(beam, tip_mass_kg=strength * load_N / G_M_S2)
    elif kind == "density":
        beam = replace(beam, density_kg_per_m3=b.density * strength)
    elif kind == "clamp-rotation":  # relative to the rotation of the beam's end under a moment, L / EI
        beam = replace(beam, clamp_rotational_rad_per_nm=strength * b.length / (E * I_m4))
    elif kind == "clamp-translation":  # relative to the beam's own compliance, L^3 / 3 EI
        beam = replace(beam, clamp_transverse_m_per_n=strength * b.length**3 / (3.0 * E * I_m4))
    elif kind == "release":
        beam = replace(beam, release_s=strength)
    elif kind == "load-delay":
        beam = replace(beam, load_start_s=strength)
    elif kind == "air-drag-linear":  # strength: rate at which drag slows the body [1/s]
        beam = replace(beam, drag_linear_ns_per_m3=strength * b.density * area / b.width)
    elif kind == "dimension-z":
        beam = replace(beam, height_m=b.height * strength, tip_offset_z_m=0.5 * b.height * strength)
    elif kind == "dimension-x":
        beam = replace(beam, length_m=b.length * strength)
    elif kind == "nonlinear-law":
        beam = replace(beam, c20_pa=strength * b.C10)
    elif kind == "camera-lag":
        lag = strength
    elif kind == "stand-off":
        more = 1e-3 * strength
    return beam, lag, more


def markers_of(body: Body) -> list[tuple[np.ndarray, np.ndarray]]:
    """Foot (3,) m and outward unit normal of the markers: two on the free end, one on top, three on the clamp."""
    L, b, h = body.length, body.width, body.height
    up, out = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    return [
        (np.array([L, 0.5 * b, 0.75 * h]), out),
        (np.array([L, 0.5 * b, 0.25 * h]), out),
        (np.array([0.6 * L, 0.5 * b, h]), up),
        (np.array([0.0, 0.2 * b, h]), up),
        (np.array([0.0, 0.9 * b, h]), up),
        (np.array([0.0, 0.9 * b, 0.1 * h]), -out),
    ]


def move(body: Body, kind: str, strength: float, load_N: float, since_s: np.ndarray) -> np.ndarray:
    """Displacements (k, 6, 3) m of the markers after the release."""
    beam, lag, more = truth_of(body, kind, strength, load_N)
    stretch_x, stretch_z = beam.length_m / body.length, beam.height_m / body.height
    mass = strength * body.mass if kind == "marker-mass" else 0.0
    asked = []
    for foot, normal in markers_of(body)[:3]:
        size = body.stand_off + more
        asked.append(
            Marker(foot[0] * stretch_x, (foot[2] - 0.5 * body.height) * stretch_z, size * normal[0], size * normal[2], mass)
        )
    beam = replace(beam, marker_masses_have_weight=True, tip_mass_has_weight=False)
    t = since_s - lag
    moved = simulate(beam, asked, np.maximum(t, 0.0))
    displacement = np.zeros((len(since_s), 6, 3))
    displacement[:, :3, 0], displacement[:, :3, 2] = moved[:, :, 0], moved[:, :, 1]
    displacement[t <= 0.0] = 0.0
    return displacement


def scenario_text(body: Body, cells: tuple[int, int, int]) -> str:
    b = body
    return f"""title = "Released beam"

[model]
box_mm = [{1e3 * b.length!r}, {1e3 * b.width!r}, {1e3 * b.height!r}]
cells = {list(cells)}
fixed = ["x0"]
material = {{ law = "neo-hooke", C10_Pa = {b.C10!r}, poisson = 0.495, density_kg_m3 = {b.density!r} }}
gravity_m_s2 = [0.0, 0.0, {-G_M_S2}]
damping = {{ alpha_per_s = {b.alpha!r} }}

[analysis]
duration_ms = 1000.0
"""


@dataclass(frozen=True)
class Moved:
    """One curve: its load, the settings that it states, and displacements (k, s, 3) m at times (k,) s since its start."""

    load_N: float
    settings: Sequence[str]
    displacement: Callable[[np.ndarray], np.ndarray]


def write_dataset(
    folder: Path,
    scenario: str,
    at_m: np.ndarray,
    curves: Sequence[Moved],
    *,
    duration_s: float,
    noise_m: float,
    stated: bool,
    rng: np.random.Generator,
) -> None:
    """A dataset of markers, of which the last three do not move; the second curve is held out.

    Parameters
    ----------
    at_m : (s, 3) centres of the markers at rest.
    noise_m : standard deviation of a coordinate.
    stated : whether the starts are stated; they are to be found otherwise.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "scenario.toml").write_text(scenario, encoding="utf-8")
    # the rig is anywhere in the room
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    shift = rng.uniform(-0.1, 0.1, 3)
    lines = [
        'format = "explicitfe-dataset/1"', f'name = "{folder.name}"', 'title = "Released body"', 'test = "trajectory"',
        'scenario = "scenario.toml"', 'fit = ["stiffness"]',
    ]  # fmt: skip
    for number, place in enumerate(at_m):
        lines += ["", "[[sensor]]", f'name = "m{number}"', f"at_mm = {[float(x) for x in 1e3 * place]}", "place_sd_mm = 0.3"]
        lines += ["fixed = true"] if number >= len(at_m) - 3 else []
    for number, curve in enumerate(curves):
        rows = np.arange(REST_ROWS + int(duration_s * RATE_HZ)) / RATE_HZ
        start = REST_ROWS / RATE_HZ + (0.0 if stated else rng.uniform(-0.4, 0.4) / RATE_HZ)
        placed = at_m + rng.normal(scale=2e-4, size=at_m.shape)
        positions = placed + curve.displacement(rows - start)
        seen = positions @ turn.T + shift + rng.normal(scale=noise_m, size=positions.shape)
        head = ["time_s", *(f"m{k}_{axis}_mm" for k in range(len(at_m)) for axis in "xyz")]
        table = np.column_stack([rows, 1e3 * seen.reshape(len(rows), -1)])
        name = f"load{number}"
        csv = "\n".join([",".join(head), *(",".join(f"{x:.6g}" for x in row) for row in table)])
        (folder / f"{name}.csv").write_text(csv + "\n", encoding="utf-8")
        lines += ["", "[[curve]]", f'id = "{name}"', f'file = "{name}.csv"']
        lines += [f"start_s = {start!r}" if stated else 'start_s = "fit"', f"conditions.load_N = {curve.load_N!r}"]
        lines += [f"conditions.settings = {list(curve.settings)!r}"] if curve.settings else []
        lines += ['split = "holdout"'] if number == 1 else []
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_case(folder: Path, body: Body, kind: str, strength: float, seed: int) -> None:
    """The dataset of one beam."""
    at = np.array([foot + body.stand_off * normal for foot, normal in markers_of(body)])
    curves = []
    for load in body.loads:
        settings = [f'load.+={{nodes=["x1","z1"], force_N=[0.0,0.0,-{load!r}]}}'] if load else []
        curves.append(Moved(load, settings, partial(move, body, kind, strength, load)))
    write_dataset(
        folder, scenario_text(body, (12, 3, 3)), at, curves,
        duration_s=0.7, noise_m=body.noise, stated=kind in ("camera-lag", "none"), rng=np.random.default_rng(seed),
    )  # fmt: skip


def plan(number: int, seed: int) -> list[tuple[str, int]]:
    """Kinds and seeds: a fifth are controls, the others take turns."""
    rng = np.random.default_rng(seed)
    kinds = [kind for kind in STRENGTHS if kind != "none"]
    controls = max(number // 5, 1)
    chosen = ["none"] * controls + [kinds[k % len(kinds)] for k in range(number - controls)]
    return [(chosen[k], int(rng.integers(1 << 30))) for k in rng.permutation(number)]


def change_share(body: Body, kind: str, strength: float) -> float:
    """Rms change of the markers by an effect under the largest load, relative to their largest displacement."""
    t = np.arange(0.0, 0.7, 1.0 / RATE_HZ)
    hidden, plain = (move(body, name, size, body.loads[-1], t) for name, size in ((kind, strength), ("none", 0.0)))
    return float(np.sqrt(np.mean((hidden - plain)[:, :3] ** 2)) / np.abs(plain).max())


def make_case(folder: Path, kind: str, seed: int) -> dict[str, object]:
    """A case whose effect can be seen, and its truth."""
    low, high = STRENGTHS[kind]
    for attempt in range(MOST_DRAWS):
        rng = np.random.default_rng([seed, attempt])
        body, strength = draw(rng), float(rng.uniform(low, high))
        if kind == "none" or change_share(body, kind, strength) > LEAST_CHANGE_SHARE:
            break
    else:
        raise ValueError(f"{kind}: none of {MOST_DRAWS} draws can be seen; raise its strengths.")
    write_case(folder, body, kind, strength, seed + 1)
    return {"kind": kind, "strength": strength, "seed": seed, "cause": CAUSE.get(kind, kind), "draws": attempt + 1}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--one", choices=list(STRENGTHS))
    parser.add_argument("--strength", type=float, default=0.0)
    options = parser.parse_args()
    if options.one:
        write_case(options.out, draw(np.random.default_rng(options.seed)), options.one, options.strength, options.seed + 1)
        return
    cases = plan(options.count, options.seed)
    names = [f"case-{k:02d}" for k in range(len(cases))]
    with ProcessPoolExecutor(2) as pool:
        truth = dict(
            zip(names, pool.map(make_case, [options.out / name for name in names], *zip(*cases, strict=True)), strict=True)
        )
    (options.out / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
