"""Draw the vowels of docs/studies/mouth.md from their results: midsagittal outlines, and F1 against F2.

python docs/pictures/draw_vowels.py FOLDER [PICTURE.png]

FOLDER holds the results of ``vowel-i-palatal``, ``vowel-e``, ``vowel-a``, ``vowel-o`` and ``vowel-u``, as ``explicitfe run``
names them.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from explicitfe.app.view.bones import fill_bones
from explicitfe.app.view.outline import outline_mm
from explicitfe.app.view.palette import COLOURS, GREY, new_figure, plain, save
from explicitfe.results.files import open_result
from explicitfe.results.measure.airway import airway_table, surroundings
from explicitfe.results.measure.formants import airway_of
from explicitfe.results.measure.sections import X, Z, midsagittal
from explicitfe.results.measure.steps import last_step

HERE = Path(__file__).resolve().parent
VOWELS = {"i": "vowel-i-palatal", "e": "vowel-e", "a": "vowel-a", "o": "vowel-o", "u": "vowel-u"}


def main() -> None:
    folder = Path(sys.argv[1])
    target = Path(sys.argv[2]) if len(sys.argv) > 2 else HERE / "five-vowels.png"
    figure = new_figure(10.0, 4.6)
    side, chart = figure.subplots(1, 2, width_ratios=[1.5, 1.0])
    for panel in (side, chart):
        plain(panel)
    for number, (vowel, scenario) in enumerate(VOWELS.items()):
        with open_result(folder / f"{scenario}.vtkhdf") as result:
            step = last_step(result)
            cut = midsagittal(result.mesh)
            if number == 0:
                around = surroundings(result, step, airway_table(result))
                fill_bones(side, result, 0, np.array([0.0, around.middle, 0.0]), np.array([0.0, 1.0, 0.0]), X, label=None)
                side.plot(*(1e3 * around.line.T), color="black", lw=1.2)
                rest = outline_mm(result, cut, result.mesh.points)
                side.plot(rest[:, X], rest[:, Z], color=GREY, lw=1.2, ls="--", label="at rest")
            outline = outline_mm(result, cut, result.mesh.points + result.displacement(step))
            side.plot(outline[:, X], outline[:, Z], color=COLOURS[number], lw=1.8, label=f"[{vowel}]")
            first, second = (formant.frequency_hz for formant in airway_of(result, step).formants[:2])
            chart.plot(second, first, "o", color=COLOURS[number], ms=8)
            chart.annotate(f"[{vowel}]", (second, first), xytext=(8, 5), textcoords="offset points", fontsize=12)
    side.set_aspect("equal")
    side.set_xlim(45.0, 142.0)
    side.set_ylim(48.0, 130.0)
    side.set_xlabel("forward  ←   mm   →  back")
    side.set_ylabel("up (mm)")
    side.set_title("midsagittal outlines at 200 ms; jaw drawn closed, as in [i]", loc="left", fontsize=10)
    side.legend(loc="center", bbox_to_anchor=(0.55, 0.4), frameon=False, fontsize=9)
    # As phoneticians draw it: front vowels on the left, high vowels above.
    chart.set_xlim(3000.0, 800.0)
    chart.set_ylim(950.0, 250.0)
    chart.set_xlabel("F2 (Hz)")
    chart.set_ylabel("F1 (Hz)")
    chart.set_title("formants", loc="left", fontsize=10)
    save(figure, target)
    print(f"written: {target}")


if __name__ == "__main__":
    main()
