"""How often the loop names what a tongue's scenario lacks: cases with a sealed truth, on simulated sensors.

    OMP_NUM_THREADS=1 python studies/benchmarks/tongue_loop_study.py make FOLDER --seed N
    OMP_NUM_THREADS=1 python studies/benchmarks/tongue_loop_study.py close FOLDER
    python studies/benchmarks/tongue_loop_study.py score FOLDER

``make`` draws scenarios, gestures and effects, and writes datasets; what is hidden goes to a file beside them that ``close`` does
not read. ``close`` asks the loop for a verdict on each dataset and appends it to a file, so that it goes on where it was stopped.
``score`` alone opens both, and prints the tables of docs/studies/close-loop-trajectories.md.

The data come from a mesh that is finer than any that the loop checks itself with, another element ("hex8-full" knows no beta)
and a smaller step. A case with an effect is drawn again until the effect moves the sensors, beyond what a turn and a shift of
their frame can imitate, by SMALLEST_CHANGE_MM rms over the two gestures that are fitted: half the noise of a coordinate.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import beta as beta_distribution
from sensor_study import experiment

from explicitfe.app.api.inverse import close_loop
from explicitfe.inverse.close_loop.trajectories.levers import levers_of
from explicitfe.inverse.close_loop.trajectories.runs import Sites, motion_of
from explicitfe.inverse.measured.registration import procrustes
from explicitfe.inverse.measured.tables import RegistrationTable
from explicitfe.platform.errors import RunError
from explicitfe.simulate.run.prepare import prepare
from explicitfe.simulate.scenario.read import read_scenario
from explicitfe.simulate.scenario.transient import TransientScenario

SENSORS = {"TT": "tip", "TB": "blade", "TF": "front", "TD": "dorsum"}
NOISE_MM, RATE_HZ, DURATION_MS = 0.2, 200.0, 80.0
FITTED, HELD = ("first", "second"), "third"
DATA_NUMERICS = ("model.cells=[18, 9, 10]", "model.element=hex8-stiffness", "analysis.step_us=20.0")
DRAWN_WITH = ("model.element=hex8-stiffness",)  # on the coarse mesh, while it is only asked how much an effect shows
SMALLEST_CHANGE_MM = 0.1
REGISTERED = RegistrationTable(rotation="fit", translation="fit")

BETA_S = 0.03
# Range of the force of each muscle in a gesture [N], both sides; GGp is always listed, and two of the others.
FORCES_N = {"GGp": (0.5, 2.5), "GGa": (0.05, 0.5), "SL": (0.05, 0.6), "STY": (0.1, 0.8), "MH": (0.2, 1.5)}
# Hidden effect -> range of its strength: clearance [mm], share of the force of all listed muscles, and beta [s], twice to four
# times the stated one.
STRENGTHS = {
    "jaw-contact": (-1.0, 2.0),
    "palate-contact": (-2.0, 0.0),
    "missing-GGh-share": (0.3, 1.2),
    "viscosity": (2.0 * BETA_S, 4.0 * BETA_S),
}
CONTROL = "none"
# Effect -> the cause of which it is a form.
CAUSES = {"viscosity": "damping", "missing-GGh-share": "missing-GGh"}
RIGHT_SHARE = 0.85


def scenario_text(random: np.random.Generator, hidden: str) -> tuple[str, list[str]]:
    """A scenario that does not have the hidden effect, and the muscles that it lists."""
    others = random.permutation([name for name in FORCES_N if name != "GGp"])
    if hidden == "palate-contact":
        others = sorted(others, key=lambda name: name != "STY")  # which lifts the dorsum
    muscles = ["GGp", *map(str, others[:2])]
    bones = [name for name in ("jaw", "palate") if random.random() < 0.5 and hidden != f"{name}-contact"]
    lines = [
        'title = "A gesture"',
        "[model]",
        'name = "tongue"',
        'resolution = "coarse"',
        'material = "buchaillard-2009"',
        "barrier = false",
        f"damping = {{ alpha_per_s = 40.0, beta_s = {BETA_S} }}",
        'attachment = "area"',
        *(f'[[bone]]\nname = "{name}"' for name in bones),
    ]
    for name in muscles:
        rise_ms, end_ms = random.uniform(10.0, 40.0), random.uniform(50.0, 75.0)
        lines.append(f'[[muscle]]\nname = "{name}"\nforce_N = 1.0\nprofile = "ramp"\ndistribution = "stress"')
        lines.append(f"rise_ms = {rise_ms:.1f}\nend_ms = {end_ms:.1f}")
    lines.append(f"[analysis]\nduration_ms = {DURATION_MS}")
    return "\n".join(lines) + "\n", muscles


def draw(folder: Path, random: np.random.Generator, hidden: str) -> dict[str, Any]:
    """Write one case into a folder, and return what is hidden in it."""
    folder.mkdir(parents=True)
    path = folder / "scenario.toml"
    begin, draws = time.perf_counter(), 0
    while True:
        draws += 1
        text, muscles = scenario_text(random, hidden)
        path.write_text(text, encoding="utf-8")
        gestures = {
            name: tuple(f"muscle.{m}.force_N={random.uniform(*FORCES_N[m]):.3f}" for m in muscles) for name in (*FITTED, HELD)
        }
        strength = float(random.uniform(*STRENGTHS[hidden])) if hidden in STRENGTHS else 0.0
        try:
            change_mm = visible_mm(path, gestures, hidden, strength)
            if hidden != CONTROL and change_mm < SMALLEST_CHANGE_MM:
                continue
            seen = {
                name: sensors(path, (*own, *added(path, own, hidden, strength), *DATA_NUMERICS)) for name, own in gestures.items()
            }
        except RunError:  # a tongue that is torn by its muscles is no measurement
            continue
        break
    turn = Rotation.from_rotvec(random.uniform(-0.3, 0.3, 3)).as_matrix()
    shift_m = random.uniform(-0.03, 0.03, 3)
    lines = [
        'format = "explicitfe-dataset/1"',
        f'name = "{folder.name}"',
        'title = "Simulated sensors"',
        'test = "trajectory"',
        'scenario = "scenario.toml"',
        *(f'[[sensor]]\nname = "{name}"\nmodel_point = "{point}"' for name, point in SENSORS.items()),
        f"[noise]\ndisplacement_sd_mm = {NOISE_MM}",
        '[registration]\nrotation = "fit"\ntranslation = "fit"',
    ]
    for name, places in seen.items():
        measured = 1e3 * (places - shift_m) @ turn + NOISE_MM * random.standard_normal(places.shape)
        head = ",".join(["time_s", *(f"{sensor}_{axis}_mm" for sensor in SENSORS for axis in "xyz")])
        rows = np.column_stack([times_s(), measured.reshape(len(measured), -1)])
        body = "\n".join(",".join(f"{x:.6f}" for x in row) for row in rows)
        (folder / f"{name}.csv").write_text(f"{head}\n{body}\n", encoding="utf-8")
        lines.append(f'[[curve]]\nid = "{name}"\nfile = "{name}.csv"\nsplit = "{"holdout" if name == HELD else "fit"}"')
        lines.append(f"conditions = {{ settings = {list(gestures[name])!r} }}")
    (folder / "dataset.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    truth = {"case": folder.name, "hidden": hidden, "strength": strength, "change_mm": change_mm, "draws": draws}
    return truth | {"gestures": gestures, "seconds": round(time.perf_counter() - begin, 1)}


def times_s() -> np.ndarray:
    """Instants of the rows."""
    return np.arange(0.0, 1e-3 * DURATION_MS + 1e-9, 1.0 / RATE_HZ)


def added(path: Path, own: Sequence[str], hidden: str, strength: float) -> list[str]:
    """The settings that a hidden effect adds to those of a gesture."""
    if hidden == CONTROL:
        return []
    scenario, _ = read_scenario(path, own)
    assert isinstance(scenario, TransientScenario)
    # forces that differ between gestures, so that a share of them is a lever of its own
    weaker = scenario.model_copy(update={"muscle": scenario.muscle[:1]})
    lever = levers_of(experiment(scenario, [scenario, weaker], path))[hidden]
    (parameter,) = lever.sought
    return lever.settings(scenario, {parameter: strength})


def sensors(path: Path, settings: Sequence[str]) -> np.ndarray:
    """Places (k, s, 3) m of the sensors, which sit on the points of the scenario's own mesh."""
    mesh = prepare(path).model.mesh
    at_rest = np.concatenate([mesh.named_points[point].position for point in SENSORS.values()])
    return at_rest + motion_of(path, settings, Sites.at(at_rest), times_s()).displacement


def visible_mm(path: Path, gestures: dict[str, tuple[str, ...]], hidden: str, strength: float) -> float:
    """Rms change [mm] of all coordinates by an effect, over the fitted gestures, beyond a turn and a shift."""
    if hidden == CONTROL:
        return 0.0
    pairs = [
        (sensors(path, (*own, *DRAWN_WITH)), sensors(path, (*own, *added(path, own, hidden, strength), *DRAWN_WITH)))
        for own in (gestures[name] for name in FITTED)
    ]
    without, with_it = (np.concatenate([pair[k].reshape(-1, 3) for pair in pairs]) for k in (0, 1))
    imitated = procrustes(REGISTERED, without, with_it).to_sensors(without)
    return float(1e3 * np.sqrt(np.mean((with_it - imitated) ** 2)))


def make(folder: Path, seed: int, each: int, controls: int) -> None:
    """All cases, in an order that says nothing; those that are finished stay."""
    kinds = [name for name in STRENGTHS for _ in range(each)] + [CONTROL] * controls
    order = np.random.default_rng([seed, len(kinds)]).permutation(len(kinds))
    folder.mkdir(parents=True, exist_ok=True)
    finished = {truth["case"] for truth in read(folder / "truth.jsonl")}
    for number, kind in enumerate(order):
        name = f"case-{number + 1:02d}"
        if name in finished:
            continue
        for half in (folder / "cases" / name).glob("*"):
            half.unlink()
        if (folder / "cases" / name).exists():
            (folder / "cases" / name).rmdir()
        truth = draw(folder / "cases" / name, np.random.default_rng([seed, number]), kinds[kind])
        append(folder / "truth.jsonl", truth)
        print(name, truth["seconds"], "s", flush=True)


def close(folder: Path, max_effects: int) -> None:
    """A verdict on each case that has none."""
    finished = {verdict["case"] for verdict in read(folder / "verdicts.jsonl")}
    for dataset in sorted((folder / "cases").glob("*/dataset.toml")):
        name = dataset.parent.name
        if name in finished:
            continue
        begin, cpu = time.perf_counter(), time.process_time()
        report = close_loop(dataset.parent, processes=1, max_effects=max_effects)
        held = [
            model.error.curves[HELD].rmse if HELD in model.error.curves else None for model in (report.baseline, report.final)
        ]
        strengths = {key: value.model_dump() for key, value in report.final.parameters.items() if "." in key}
        verdict = {
            "case": name,
            "verdict": report.verdict,
            "remainder": report.remainder,
            "effects": report.effects,
            "ambiguous_with": report.ambiguous_with,
            "nearest": report.nearest,
            "strengths": strengths,
            "held_mm": held,
            "message": report.message,
            "causes": report.posterior,
            "wall_s": round(time.perf_counter() - begin, 1),
            "cpu_s": round(time.process_time() - cpu, 1),
        }
        append(folder / "verdicts.jsonl", verdict)
        print(
            json.dumps({key: verdict[key] for key in ("case", "verdict", "effects", "ambiguous_with", "wall_s", "cpu_s")}),
            flush=True,
        )


def outcome_of(hidden: str, verdict: dict[str, Any]) -> str:
    """named | ambiguous, with the true one among those named | silent | and what is wrong otherwise."""
    found = {cause_of(name) for name in verdict["effects"]}
    named = found | {cause_of(name) for name in verdict["ambiguous_with"]}
    if hidden == CONTROL:
        return "silent" if verdict["verdict"] == "no-missing-effect" else "false alarm"
    if verdict["verdict"] == "effect-found":
        if found == {cause_of(hidden)}:
            return "named"
        return "named with another" if cause_of(hidden) in found else "another named"
    if verdict["verdict"] == "ambiguous":
        return "ambiguous with it" if cause_of(hidden) in named else "ambiguous without it"
    return "missed" if verdict["verdict"] == "no-missing-effect" else str(verdict["verdict"])


def cause_of(effect: str) -> str:
    """The cause of which an effect is a form."""
    return CAUSES.get(effect, effect.removesuffix("-shifted").removesuffix("-rough"))


RIGHT = ("named", "ambiguous with it", "silent")


def score(folder: Path) -> None:
    """The tables, and every case that is not right."""
    verdicts = {verdict["case"]: verdict for verdict in read(folder / "verdicts.jsonl")}
    rows = [(truth, verdicts[truth["case"]]) for truth in read(folder / "truth.jsonl") if truth["case"] in verdicts]
    outcomes = {
        hidden: Counter(outcome_of(hidden, v) for t, v in rows if t["hidden"] == hidden) for hidden in (*STRENGTHS, CONTROL)
    }
    columns = [
        name
        for name in dict.fromkeys(RIGHT + tuple(o for c in outcomes.values() for o in c))
        if any(c[name] for c in outcomes.values())
    ]
    print(f"| hidden | cases | {' | '.join(columns)} | change by the effect, rms mm | held-out gesture, rms mm |")
    print("|---|" + "---|" * (len(columns) + 3))
    for hidden, counts in outcomes.items():
        own = [(t, v) for t, v in rows if t["hidden"] == hidden]
        if not own:
            continue
        changes = np.array([t["change_mm"] for t, _ in own])
        held = np.array([v["held_mm"] for _, v in own if None not in v["held_mm"]], dtype=float)
        span = "" if hidden == CONTROL else f"{changes.min():.2f} to {changes.max():.2f}"
        error = " -> ".join(f"{value:.2f}" for value in np.median(held, axis=0))
        print(f"| {hidden} | {len(own)} | {' | '.join(str(counts[c]) for c in columns)} | {span} | {error} |")
    for label, of in (("with an effect", [*STRENGTHS]), ("controls", [CONTROL])):
        total = sum(sum(outcomes[hidden].values()) for hidden in of)
        right = sum(outcomes[hidden][o] for hidden in of for o in RIGHT)
        low = beta_distribution.ppf(0.025, right, total - right + 1) if right else 0.0
        high = beta_distribution.ppf(0.975, right + 1, total - right) if right < total else 1.0
        print(f"\n{label}: {right} of {total} right, {100 * low:.0f} to {100 * high:.0f} % (95 %, Clopper and Pearson)", end="")
    print(f"\n{RIGHT_SHARE:.0%} was the aim; draws for {len(rows)} cases: {sum(t['draws'] for t, _ in rows)}\n")
    for truth, verdict in rows:
        outcome = outcome_of(truth["hidden"], verdict)
        if outcome not in RIGHT:
            print(truth["case"], outcome, truth["hidden"], round(truth["strength"], 3), f"{truth['change_mm']:.2f} mm:", end=" ")
            print(verdict["verdict"], verdict["effects"], verdict["ambiguous_with"], verdict["nearest"], verdict["message"])


def read(path: Path) -> list[dict[str, Any]]:
    """The lines of a file of JSON lines; none where there is no file."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []


def append(path: Path, entry: dict[str, Any]) -> None:
    """A line more."""
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(entry) + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task", choices=["make", "close", "score"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--each", type=int, default=10, help="cases of each effect")
    parser.add_argument("--controls", type=int, default=10)
    parser.add_argument("--max-effects", type=int, default=1, help="effects that the loop may add")
    chosen = parser.parse_args()
    if chosen.task == "make":
        make(chosen.folder, chosen.seed, chosen.each, chosen.controls)
    elif chosen.task == "close":
        close(chosen.folder, chosen.max_effects)
    else:
        score(chosen.folder)


if __name__ == "__main__":
    main()
