"""Draw the airway of docs/reference/airway.md from a result: midline and sections, areas, transfer function, formants over time.

python docs/pictures/draw_airway.py RESULT.vtkhdf [PICTURE.png [TIME_MS]]
"""

from __future__ import annotations

import sys
from pathlib import Path

from explicitfe.app.view.airway import airway_figure
from explicitfe.app.view.palette import save
from explicitfe.results.files import open_result
from explicitfe.results.measure.steps import step_at

HERE = Path(__file__).resolve().parent


def main() -> None:
    target = Path(sys.argv[2]) if len(sys.argv) > 2 else HERE / "airway.png"
    time_s = 1e-3 * float(sys.argv[3]) if len(sys.argv) > 3 else None
    with open_result(Path(sys.argv[1])) as result:
        figure = airway_figure(result, step_at(result, time_s), over_time=True)
    if figure is None:
        sys.exit("this result has no airway: it needs the built-in tongue and its palate")
    save(figure, target)
    print(f"written: {target}")


if __name__ == "__main__":
    main()
