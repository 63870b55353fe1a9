"""What the model says to what is known of a tongue, one effect at a time: the tables and pictures of docs/studies/findings.md.

    python studies/benchmarks/findings.py OUT [--only gestures-cadaver ...] [--no-runs] [--page docs]

Each run is computed once and kept in OUT as numbers, so that a stopped study goes on. ``--page docs`` puts the tables whose runs
are there into the page, and draws the pictures. Rows of the measured tongue need its folder (see real_tongue.py), beside the
repository or where ``EXPLICITFE_SHARED_DATA`` points. Some 250 runs, half an hour.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from elements import table
from findings_pictures import Panel, draw_palate, draw_shapes, draw_steps
from tongue_cases import BONES, CADAVER, LIVING, MEASURED, Answer, Case, Laboratory, MissingRunError, case

# ---- what is asked ----

# GGp of the paper is the four fibres of our GGp and the two of GGh, equal in force.
GGP = {"GGp": 4.0 / 3.0, "GGh": 2.0 / 3.0}
VOWEL_I = {**GGP, "GGa": 0.2}
GGA = {"GGa": 0.5}
SL = {"SL": 0.5}
BRACED = {**GGP, "GGa": 0.3, "SL": 0.15, "MH": 1.0}
GESTURES = {"[i]": VOWEL_I, "GGp 2 N": GGP, "GGa 0.5 N": GGA, "SL 0.5 N": SL, "braced [i]": BRACED}
# The jaw is 2 mm nearer than at rest in [i], and with GGp alone, which is compared with it.
JAW_MM = {"[i]": -2.0, "GGp 2 N": -2.0, "braced [i]": -2.0}
IN_I = {"jaw_mm": -2.0}
NAMES_OF_TISSUES = {CADAVER: "cadaver", LIVING: "living"}
# C10 of living over cadaver tissue: forces so much larger act on it as the others do on the cadaver.
STIFFER = 5.4
POINTS = ("tip", "blade", "front", "dorsum")
FORWARD, UP = 0, 1
RAMP_MS = 50.0
ROUNDING = 0.05  # of the figures in the tables: a figure that rounds to the limit meets it


def gesture(name: str, **settings: Any) -> Case:
    return case(GESTURES[name], **{"jaw_mm": JAW_MM.get(name, 0.0)} | settings)


@dataclass(frozen=True)
class Asked:
    """A figure that a gesture should show, and between what it should lie."""

    gesture: str
    tissue: str
    what: str
    value: Callable[[Answer], float]
    low: float = -np.inf
    high: float = np.inf
    settings: tuple[tuple[str, Any], ...] = ()
    more_than: str | None = None  # the figure counts above that of this gesture

    def cases(self, **settings: Any) -> list[Case]:
        names = [name for name in (self.gesture, self.more_than) if name is not None]
        return [gesture(name, tissue=self.tissue, **dict(self.settings), **settings) for name in names]

    def seen(self, laboratory: Laboratory, **settings: Any) -> float:
        first, *others = [self.value(laboratory.answer(each)) for each in self.cases(**settings)]
        return first - sum(others)

    def short_by(self, value: float) -> float:
        """How far outside of what is asked a figure lies; 0: it is met."""
        return max(0.0, self.low - value, value - self.high)

    @property
    def range(self) -> str:
        if np.isinf(self.high):
            return f"{self.low:g} or more".replace("-", "−")
        return f"{self.high:g} or less" if np.isinf(self.low) else f"{self.low:g} to {self.high:g}"


def moved(point: str, along: int) -> Callable[[Answer], float]:
    return lambda answer: answer.moved(point)[along]


def back(point: str) -> Callable[[Answer], float]:
    return lambda answer: -answer.moved(point)[FORWARD]


def down(point: str) -> Callable[[Answer], float]:
    return lambda answer: -answer.moved(point)[UP]


def front_groove(answer: Answer) -> float:
    return answer.measures.grooves["front"].depth_mm


def fastest(answer: Answer) -> float:
    return answer.measures.body.fastest_mm_s


def time_to_90(point: str) -> Callable[[Answer], float]:
    return lambda answer: answer.measures.points[point].time_to_90_ms or 0.0


def peak_speed(point: str) -> Callable[[Answer], float]:
    return lambda answer: answer.measures.points[point].peak_speed_mm_s


PLACES_ASKED = {
    CADAVER: [
        *(Asked("[i]", CADAVER, f"{point} forward, mm", moved(point, FORWARD), 5.0, 11.0) for point in POINTS[1:]),
        *(Asked("[i]", CADAVER, f"{point} up, mm", moved(point, UP), 0.5) for point in POINTS[2:]),
        Asked("[i]", CADAVER, "tip up, mm", moved("tip", UP), -1.0),
    ],
    LIVING: [
        *(Asked("[i]", LIVING, f"{point} forward, mm", moved(point, FORWARD), 2.0, 5.0) for point in ("tip", "dorsum")),
        *(Asked("[i]", LIVING, f"{point} up, mm", moved(point, UP), 0.3) for point in ("tip", "dorsum")),
    ],
}
ASKED = [
    *PLACES_ASKED[CADAVER],
    Asked("[i]", CADAVER, "groove, mm, more than in GGp alone by", front_groove, 0.1, more_than="GGp 2 N"),
    *(Asked("GGp 2 N", CADAVER, f"{point} up, mm", moved(point, UP), 2.0) for point in POINTS[2:]),
    *(Asked("GGa 0.5 N", CADAVER, f"{point} down, mm", down(point), 3.0, 7.0) for point in POINTS[1:]),
    Asked("GGa 0.5 N", CADAVER, "blade back, mm", back("blade"), 0.3, 3.0),
    Asked("GGa 0.5 N", CADAVER, "groove, mm", front_groove, 1.0),
    *PLACES_ASKED[LIVING],
    Asked("SL 0.5 N", LIVING, "tip up, mm", moved("tip", UP), 8.0, 20.0),
    *(Asked(name, tissue, "fastest node at 200 ms, mm/s", fastest, high=20.0)
      for tissue in NAMES_OF_TISSUES for name in GESTURES if (name, tissue) != ("SL 0.5 N", CADAVER)),
    *(Asked("[i]", tissue, f"{point}, time to 90 %, ms", time_to_90(point), 60.0, 130.0)
      for tissue in NAMES_OF_TISSUES for point in POINTS),
    *(Asked("[i]", tissue, f"{point}, peak speed of a ramp, mm/s", peak_speed(point), 60.0, 200.0, (("rise_ms", RAMP_MS),))
      for tissue in NAMES_OF_TISSUES for point in POINTS),
]  # fmt: skip


# ---- tables ----

Write = Callable[["Laboratory"], str]
HEAD_OF_POINTS = ["tip", "blade", "front", "dorsum"]
HEAD_OF_TRUST = [
    "groove",
    "fastest node",
    "90 %: tip, dorsum",
    "inverted elements",
    "hourglass",
    "balance",
    "largest penetration",
]
FINEST = (30, 16, 20)
MESHES: tuple[str | tuple[int, int, int], ...] = ("coarse", "medium", "fine", FINEST)
COMPARED = ("[i]", "GGp 2 N", "GGa 0.5 N", "SL 0.5 N")


def number(value: float, digits: int = 1) -> str:
    text = f"{value:.{digits}f}"
    return (text.lstrip("-") if float(text) == 0.0 else text).replace("-", "−")


def signed(value: float) -> str:
    text = number(value)
    return text if text[0] == "−" else f"+{text}"


def pair(forward_up: tuple[float, float]) -> str:
    return ", ".join(map(signed, forward_up))


def points_of(answer: Answer, points: Iterable[str] = POINTS) -> list[str]:
    return [pair(answer.moved(point)) for point in points]


def trust_of(answer: Answer) -> list[str]:
    """Groove, speed, times, and what says how far to trust a run."""
    times = [time_to_90(point)(answer) for point in ("tip", "dorsum")]
    return [
        number(front_groove(answer)),
        number(fastest(answer), 0),
        ", ".join(number(time, 0) for time in times),
        str(answer.kept["folded"]),
        number(100.0 * answer.kept["hourglass"]),
        f"{answer.kept['balance']:.0e}",
        number(answer.kept["deepest_mm"], 2),
    ]


def gestures(laboratory: Laboratory, tissue: str) -> str:
    """Every gesture on both meshes, with and without bones."""
    rows = []
    for name in GESTURES:
        for mesh in ("medium", MEASURED):
            for bones in ((), BONES):
                answer = laboratory.answer(gesture(name, tissue=tissue, mesh=mesh, bones=bones))
                which = "built-in" if mesh == "medium" else mesh
                rows.append([name, which, "with" if bones else "without", *points_of(answer), *trust_of(answer)])
    return table(["gesture", "mesh", "bones", *HEAD_OF_POINTS, *HEAD_OF_TRUST], rows)


def asked(laboratory: Laboratory) -> str:
    """The figures asked for, what is seen, and by how much each is missed."""
    rows = []
    for each in ASKED:
        seen = [each.seen(laboratory, mesh=mesh) for mesh in ("medium", "fine", MEASURED)]
        short = each.short_by(seen[0])
        verdict = "met" if short < ROUNDING else f"short by {number(short)}"
        rows.append([each.gesture, NAMES_OF_TISSUES[each.tissue], each.what, each.range, *map(number, seen), verdict])
    return table(["gesture", "tissue", "quantity", "expected", "medium", "fine", "measured mesh", "medium: verdict"], rows)


def short_of(answer: Answer) -> float:
    """The residual of an [i] against what is asked of its shape: its worst figure, mm."""
    return max(each.short_by(each.value(answer)) for each in PLACES_ASKED[answer.case.tissue])


TO_THE_LETTER: dict[str, Any] = {"distribution": "ends", "beta_s": 0.0, "attachment": "nodes", "bones": (), "jaw_mm": 0.0}
STEPS: list[tuple[str, dict[str, Any]]] = [
    ("the paper to the letter: forces on fibre ends, alpha only, held nodes, no bones", {}),
    ("+ beta 0.03 s", {"beta_s": 0.03}),
    ("+ forces follow their fibres", {"direction": "following"}),
    ("+ along whole fibres", {"distribution": "along"}),
    ("+ as stress", {"distribution": "stress", "direction": "reference"}),
    ("+ jaw", {"bones": ("jaw",)}),
    ("+ palate and pharynx", {"bones": BONES}),
    ("+ ties by area", {"attachment": "area"}),
    ("+ jaw 2 mm nearer than at rest: **all**", IN_I),
]
ALONE: list[tuple[str, dict[str, Any]]] = [
    ("to the letter, + bones alone", TO_THE_LETTER | {"bones": BONES}),
    ("to the letter, + bones and beta", TO_THE_LETTER | {"bones": BONES, "beta_s": 0.03}),
    ("all, jaw at rest", {"jaw_mm": 0.0}),
    ("all, without the jaw", {"bones": ("palate", "pharynx"), "jaw_mm": 0.0}),
    ("all, without palate and pharynx", {"bones": ("jaw",)}),
    ("all, without beta", {"beta_s": 0.0}),
    ("all, forces on fibre ends instead of stress", {"distribution": "ends"}),
    ("all, + hyoid on springs of 0.5 N/mm", {"hyoid_N_mm": 0.5}),
    ("all, + hyoid on springs of 0.2 N/mm", {"hyoid_N_mm": 0.2}),
    ("all, + weaker when short (`force_length`)", {"force_length": True}),
    ("all, + stiffer when active (`activation_stiffening`)", {"stiffening": True}),
    ("all, the 2 N on the upper four fibres, none on GGh", {"pulls": {"GGp": 2.0, "GGa": 0.2}}),
    ("all, in ramps of 50 ms", {"rise_ms": RAMP_MS}),
]


def steps() -> list[tuple[str, dict[str, Any]]]:
    """The settings after each step, on top of those before."""
    settings, rows = dict(TO_THE_LETTER), []
    for label, change in STEPS:
        settings |= change
        rows.append((label, dict(settings)))
    return rows


def one_at_a_time(laboratory: Laboratory) -> str:
    """[i] from the paper to the letter to all effects, and what each does alone."""
    cells = []
    for label, chosen in [*steps(), *ALONE]:
        answers = [laboratory.answer(case(**{"pulls": VOWEL_I} | IN_I | chosen, tissue=tissue)) for tissue in NAMES_OF_TISSUES]
        shown = []
        for answer in answers:
            residual = number(short_of(answer))
            shown += [*points_of(answer, ("tip", "front", "dorsum")), number(fastest(answer), 0), f"**{residual}**"]
        cells.append([label, *shown])
    head = [f"{name}: {what}" if what == "tip" else what for name in ("cadaver", "living")
            for what in ("tip", "front", "dorsum", "fastest node", "shortfall, mm")]  # fmt: skip
    return table(["[i]", *head], cells)


def shifted_bones(laboratory: Laboratory) -> str:
    """What the place of the bones changes."""
    rows = []
    shifts = {"as drawn": (0.0, 0.0, 0.0), "2 mm back": (2.0, 0.0, 0.0), "2 mm forward": (-2.0, 0.0, 0.0),
              "2 mm up": (0.0, 0.0, 2.0), "2 mm down": (0.0, 0.0, -2.0)}  # fmt: skip
    for tissue, called in NAMES_OF_TISSUES.items():
        for label, shift_mm in shifts.items():
            answer = laboratory.answer(case(VOWEL_I, tissue=tissue, shift_mm=shift_mm, **IN_I))
            braced = laboratory.answer(case(braced_forces(tissue), tissue=tissue, shift_mm=shift_mm, **IN_I))
            lowered = laboratory.answer(case(GGA, tissue=tissue, shift_mm=shift_mm))
            free = "free" if braced.measures.contact["palate"].midline_free else "closed"
            cells = [called, label, *points_of(answer), number(short_of(answer)), *points_of(lowered, ("blade",)), free]
            rows.append(cells)
    head = ["tissue", "bones", *(f"[i]: {point}" for point in POINTS), "shortfall, mm", "GGa: blade", "braced [i]: midline"]
    return table(head, rows)


def apart(one: Answer, other: Answer) -> float:
    """The largest distance of a point between two answers, mm."""
    return max(float(np.hypot(*np.subtract(one.moved(point), other.moved(point)))) for point in POINTS)


def mesh_errors(laboratory: Laboratory) -> str:
    """Meshes and elements beside each other: how far points move, and what the hourglass share does meanwhile."""
    rows = []
    for tissue, called in NAMES_OF_TISSUES.items():
        for name in COMPARED:
            finest = laboratory.answer(gesture(name, tissue=tissue, mesh=FINEST))
            for mesh in MESHES:
                answer = laboratory.answer(gesture(name, tissue=tissue, mesh=mesh))
                plain, full = (
                    laboratory.answer(gesture(name, tissue=tissue, mesh=mesh, element=element, beta_s=0.0))
                    if mesh in ("medium", "fine") else None for element in ("hex8", "hex8-full")
                )  # fmt: skip
                compared = "" if plain is None or full is None else number(apart(plain, full))
                share = number(100.0 * answer.kept["hourglass"])
                mesh_name = mesh if isinstance(mesh, str) else ", ".join(map(str, mesh))
                away = "" if mesh == FINEST else number(apart(answer, finest))
                rows.append([called, name, mesh_name, *points_of(answer), number(front_groove(answer)), away, share, compared])
    head = [
        "tissue",
        "gesture",
        "mesh",
        *HEAD_OF_POINTS,
        "groove",
        "difference from the finest mesh",
        "hourglass",
        "difference from hex8-full",
    ]
    return table(head, rows)


SIGNS: dict[str, tuple[str, Callable[[Answer], bool]]] = {
    "HG": ("dorsum back and down", lambda a: a.moved("dorsum")[FORWARD] < 0.0 > a.moved("dorsum")[UP]),
    "STY": ("dorsum back and up", lambda a: a.moved("dorsum")[FORWARD] < 0.0 < a.moved("dorsum")[UP]),
    "GGm": ("dorsum down", lambda a: a.moved("dorsum")[UP] < 0.0),
    "TRANS": ("dorsum up", lambda a: a.moved("dorsum")[UP] > 0.0),
    "MH": ("dorsum up", lambda a: a.moved("dorsum")[UP] > 0.0),
    "IL": ("tip down and back", lambda a: a.moved("tip")[FORWARD] < 0.0 > a.moved("tip")[UP]),
    "VERT": ("flatter", lambda a: a.measures.highest is not None and a.measures.highest.up_mm < 0.0),
}
ALONE_N = {CADAVER: 0.3, LIVING: 1.0}


def single_muscles(laboratory: Laboratory) -> str:
    """Muscles alone, and whether the dorsum goes where it should."""
    rows = []
    for name, (sign, holds) in SIGNS.items():
        cells = [name, sign]
        for tissue, force_N in ALONE_N.items():
            answer = laboratory.answer(case({name: force_N}, tissue=tissue))
            cells += [*points_of(answer, ("tip", "front", "dorsum")), "yes" if holds(answer) else "no"]
        rows.append(cells)
    head = [f"{called}: {what}" if what == "tip" else what for called in ("cadaver, 0.3 N", "living, 1 N")
            for what in ("tip", "front", "dorsum", "as expected")]  # fmt: skip
    return table(["muscle", "expected motion of the dorsum", *head], rows)


def braced_forces(tissue: str) -> dict[str, float]:
    """Of the braced [i]; larger on the living tissue as it is stiffer."""
    return {name: force_N * (STIFFER if tissue == LIVING else 1.0) for name, force_N in BRACED.items()}


def palate_contact(laboratory: Laboratory) -> str:
    """Where a braced [i] touches the palate, and what of it opens the midline."""
    rows = []
    variants: list[tuple[str, str, dict[str, Any], dict[str, Any]]] = []
    for tissue, called in NAMES_OF_TISSUES.items():
        forces = braced_forces(tissue)
        variants += [(called, "braced [i]", forces, {"tissue": tissue})]
        variants += [(called, f"without {name}", {k: v for k, v in forces.items() if k != name}, {"tissue": tissue})
                     for name in ("GGa", "SL", "MH")]  # fmt: skip
        variants += [(called, "GGp, GGh only", {name: forces[name] for name in GGP}, {"tissue": tissue})]
        variants += [(called, "fine mesh", forces, {"tissue": tissue, "mesh": "fine"})]
        variants += [(called, "measured mesh", forces, {"tissue": tissue, "mesh": MEASURED})]
    variants += [("living", "unscaled forces", BRACED, {"tissue": LIVING})]
    variants += [("living", "[i], unscaled", VOWEL_I, {"tissue": LIVING})]
    for called, label, forces, settings in variants:
        answer = laboratory.answer(case(forces, **IN_I, **settings))
        contact = answer.measures.contact["palate"]
        cells = [" / ".join(number(part.area_mm2, 0) for part in side.values()) for side in contact.cells.values()]
        free = "free" if contact.midline_free else "closed"
        pressure = f"{contact.mean_kPa:.2f}, {contact.peak_kPa:.2f}"
        rows.append([called, label, *points_of(answer, ("tip", "dorsum")), number(front_groove(answer)), *cells, pressure, free])
    head = ["tissue", "", "tip", "dorsum", "groove", "left", "centre", "right", "kPa: mean, peak", "midline"]
    return table(head, rows)


def stays_from(answer: Answer, point: str) -> float:
    """The other time to 90 %: from when on a point stays within 10 % of its path from its end, ms."""
    arrays = answer.arrays
    path = arrays["paths"][:, answer.kept["points"].index(point)]
    away = np.linalg.norm(path - path[-1], axis=1) / np.linalg.norm(path[-1])
    late = np.flatnonzero(away > 0.1)
    return 1e3 * float(arrays["times"][late[-1] + 1]) if len(late) else 0.0


def times(laboratory: Laboratory) -> str:
    """How long a gesture takes and how fast points go, for steps and for ramps."""
    rows = []
    for tissue, called in NAMES_OF_TISSUES.items():
        for name in GESTURES:
            for rise_ms in (0.0, RAMP_MS):
                answer = laboratory.answer(gesture(name, tissue=tissue, rise_ms=rise_ms))
                cells = [called, name, "ramp" if rise_ms else "step"]
                for point in ("tip", "dorsum"):
                    way, peak = float(np.hypot(*answer.moved(point))), peak_speed(point)(answer)
                    cells += [number(way), number(time_to_90(point)(answer), 0), number(stays_from(answer, point), 0)]
                    cells += [number(peak, 0), number(peak / way, 0)]
                rows.append(cells)
    head = [f"{point}: {what}" if what == "path" else what for point in ("tip", "dorsum")
            for what in ("path", "90 % at", "within 10 % from", "peak", "peak / path")]  # fmt: skip
    return table(["tissue", "gesture", "forces", *head], rows)


TABLES: dict[str, Write] = {
    "asked": asked,
    "one-at-a-time": one_at_a_time,
    "gestures-cadaver": lambda laboratory: gestures(laboratory, CADAVER),
    "gestures-living": lambda laboratory: gestures(laboratory, LIVING),
    "mesh-errors": mesh_errors,
    "shifted-bones": shifted_bones,
    "palate-contact": palate_contact,
    "single-muscles": single_muscles,
    "times": times,
}


# ---- page ----


def draw_pictures(laboratory: Laboratory, folder: Path) -> None:
    """Before and after, where the palate is touched, and how far each step brings [i]."""
    rows = []
    for tissue, called in NAMES_OF_TISSUES.items():
        scaled = f", forces × {STIFFER:g}" if tissue == LIVING else ""
        rows.append([
            Panel(f"{called}: [i], the paper to the letter", case(VOWEL_I, tissue=tissue, **TO_THE_LETTER)),
            Panel(f"{called}: [i], all effects", case(VOWEL_I, tissue=tissue, **IN_I)),
            Panel(f"{called}: braced [i]{scaled}", case(braced_forces(tissue), tissue=tissue, **IN_I)),
        ])  # fmt: skip
    draw_shapes(laboratory, rows, folder / "findings-shapes.png")
    forces = braced_forces(LIVING)
    panels = [
        Panel("braced [i]", case(forces, tissue=LIVING, **IN_I)),
        Panel("without GGa", case({k: v for k, v in forces.items() if k != "GGa"}, tissue=LIVING, **IN_I)),
        Panel("GGp and GGh only", case({name: forces[name] for name in GGP}, tissue=LIVING, **IN_I)),
    ]
    draw_palate(laboratory, panels, folder / "findings-palate.png")
    residuals = {
        called: [short_of(laboratory.answer(case(VOWEL_I, tissue=tissue, **IN_I | chosen))) for _, chosen in steps()]
        for tissue, called in NAMES_OF_TISSUES.items()
    }
    labels = [label.partition(":")[0] for label, _ in steps()]
    draw_steps(labels, residuals, folder / "findings-steps.png")


def write_page(laboratory: Laboratory, folder: Path, names: Iterable[str]) -> None:
    """Put tables into docs/studies/findings.md, between their marks."""
    page = folder / "studies" / "findings.md"
    text = page.read_text(encoding="utf-8")
    for name in names:
        try:
            written = TABLES[name](laboratory)
        except MissingRunError:
            print(f"{name}: runs are missing, so its table stays as it is")
            continue
        mark, end = f"<!-- {name} -->", f"<!-- end {name} -->"
        before, _, rest = text.partition(mark)
        text = before + mark + "\n\n" + written + "\n\n" + end + rest.partition(end)[2]
    page.write_text(text, encoding="utf-8")
    try:
        draw_pictures(laboratory, folder / "pictures")
    except MissingRunError:
        print("runs are missing, so the pictures stay as they are")
    print(f"written: {page}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path, help="folder in which what came of the runs is kept")
    parser.add_argument("--only", nargs="*", choices=list(TABLES), default=list(TABLES), help="run what these tables need")
    parser.add_argument("--no-runs", action="store_true", help="run nothing: use what is kept")
    parser.add_argument("--page", type=Path, help="folder of the pages: put in the tables, draw the pictures")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    laboratory = Laboratory(arguments.out, computes=not arguments.no_runs)
    if not arguments.no_runs:
        for name in arguments.only:
            print(f"\n{name}\n\n{TABLES[name](laboratory)}", flush=True)
    laboratory.computes = False
    if arguments.page:
        write_page(laboratory, arguments.page, arguments.only)


if __name__ == "__main__":
    main()
