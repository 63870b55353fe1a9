"""docs/reference/extending.md: what the page says to add is added to a copy of the package, and computes what its equations say.

Files that the page shows are written where it says, and its diffs applied, in the order of the page; then each test runs a
program in the copy. Laws and effects that are added so are right without a line changed elsewhere. References are energies in
numpy (tests/energies.py); 1e-9 of the largest stress, which is K |J - 1| and rounded by some 100 eps.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from docs_blocks import blocks_of
from energies import derivative, series_energy
from support import ROOT

pytestmark = pytest.mark.slow

PAGE = (ROOT / "docs" / "reference" / "extending.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.M | re.S)
PLACE = re.compile(r"`(explicitfe/[\w/]+\.py)`")


def edited(text: str, diff: str) -> str:
    """A file with a diff block applied: its lines with `+` come after what they follow, those with `-` go.

    Lines may be left out between those that are shown; context and removed lines are looked for in order.
    """
    lines, at = text.split("\n"), 0
    shown = diff.rstrip("\n").split("\n")
    waiting: list[str] = []  # new lines that stand before the next one that is shown
    for line in shown:
        mark, content = line[:1], line[1:]
        if mark == "+":
            waiting.append(content)
            continue
        place = lines.index(content, at)
        if mark == "-":
            del lines[place]
        lines[place:place] = waiting
        at = place + len(waiting) + (mark != "-")
        waiting = []
    lines[at:at] = waiting
    return "\n".join(lines)


@pytest.fixture(scope="module")
def package(tmp_path_factory) -> Path:
    """A copy of the package with all that the page adds."""
    folder = tmp_path_factory.mktemp("scratch")
    for name in ("explicitfe", "models", "scenarios"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for match in BLOCK.finditer(PAGE):
        language, block = match.groups()
        paragraph = PAGE[: match.start()].rstrip().rpartition("\n\n")[2]
        places = PLACE.findall(paragraph)
        if language == "python" and places and paragraph.endswith(f"`{places[-1]}`:"):
            assert not (folder / places[-1]).exists(), f"{places[-1]} is there already; the page shows a new file"
            (folder / places[-1]).write_text(block, encoding="utf-8")
        elif language == "diff":
            path = folder / places[-1]
            path.write_text(edited(path.read_text(encoding="utf-8"), block), encoding="utf-8")
    return folder


def in_package(package: Path, code: str) -> str:
    """What a program prints that runs with the copy."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(package), str(ROOT / "tests")])}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, cwd=package, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_block_is_used():
    """Blocks are files, diffs, tables of a scenario, and one program: of each as many as the tests here run."""
    kinds = [block.language for block in blocks_of("reference/extending.md")]
    assert {kind: kinds.count(kind) for kind in set(kinds)} == {"python": 5, "diff": 4, "toml": 2}


def test_the_program_runs(package):
    """The block that looks at the law: P = 2 w (l - l^-2), w = mu / 2 exp(b (I1 - 3)), but for what J - 1 = p / K leaves: 1 %."""
    (program,) = [block.text for block in blocks_of("reference/extending.md") if "point.uniaxial" in block.text]
    printed = np.array(in_package(package, program).strip("[] \n").split(), dtype=float)
    stretch = np.linspace(1.0, 1.5, 6)
    slope = 0.5 * 2074.0 * np.exp(stretch**2 + 2.0 / stretch - 3.0)
    assert printed == pytest.approx(2.0 * slope * (stretch - stretch**-2), rel=0.01, abs=1e-6)


SCENARIO = """
from explicitfe.simulate.scenario.read import read_scenario
scenario, _ = read_scenario("scenarios/vowel-i.toml", ['model.material={material}', 'effects.{effect}'])
print(scenario.model.material.law, [type(effect).__name__ for effect in scenario.effects.chosen])
"""


def test_scenarios_take_the_law_and_the_effect(package):
    """The TOML blocks are settings of a scenario; a wrong constant is refused with a sentence that names the law's own."""
    law, effect = (block.text.strip() for block in blocks_of("reference/extending.md") if block.language == "toml")
    material = law.partition("=")[2].strip()
    printed = in_package(package, SCENARIO.format(material=material, effect=effect))
    assert printed.split() == ["demiray", "['FourthYeoh']"]
    code = SCENARIO.format(material=material.replace("mu_Pa", "mu"), effect=effect)
    wrong = f"""
from explicitfe.platform.errors import InputError
try:
    exec({code!r})
except InputError as error:
    print(error)
"""
    assert "mu_Pa" in in_package(package, wrong)


LAWS = """
import json
import numpy as np
from energies import derivative, invariants, series_energy, volume_energy
from support import block_mesh, model_of, random_gradient, random_rotation
from explicitfe.fem.effects.material.third_yeoh import ThirdYeoh
from explicitfe.fem.materials.demiray import Demiray
from explicitfe.fem.materials.isihara import Isihara
from explicitfe.fem.solve import point
from explicitfe.fem.solve.simulation import Simulation

edge = 0.01
mesh = block_mesh((1, 1, 1), edge, distort=0.0)
rng = np.random.default_rng(14)
states = np.array([random_rotation(rng) @ random_gradient(rng, 0.35) for _ in range(8)])


def in_an_element(law, element, effects):
    stress = []
    for F in states:
        body = Simulation(model_of(mesh, law, element=element, effects=effects))
        force = body.internal_force(mesh.points @ (F - np.eye(3)).T)
        stress.append(np.column_stack([force[mesh.node_sets[f"{axis}1"]].sum(axis=0) for axis in "xyz"]) / edge**2)
    return np.array(stress)


def off_by(stress, law, energy):
    wanted = np.array([derivative(F, energy, volume_energy(law.constants()[-1])) for F in states])
    return float(np.abs(stress - wanted).max() / np.abs(wanted).max())


off = {}
none = (ThirdYeoh(C30_Pa=0.0),)
for name, C20 in (("mooney-rivlin", 0.0), ("isihara", 90.0)):
    law, energy = Isihara(law="isihara", C10_Pa=120.0, C20_Pa=C20, C01_Pa=70.0), series_energy(120.0, C20, 70.0)
    for element in ("hex8", "hex8-full"):
        off[f"{name}, {element}"] = off_by(in_an_element(law, element, ()), law, energy)
    off[f"{name}, an effect of strength zero"] = off_by(in_an_element(law, "hex8", none), law, energy)

demiray = Demiray(law="demiray", mu_Pa=2074.0, b=1.5)
energy = lambda F: 2074.0 / 3.0 * (np.exp(1.5 * (invariants(F)[0] - 3.0)) - 1.0)
off["demiray, a point"] = off_by(point.path(demiray, (), np.zeros(len(states)), states, [])[0], demiray, energy)
off["demiray, hex8-full"] = off_by(in_an_element(demiray, "hex8-full", ()), demiray, energy)
print(json.dumps(off))
"""


def test_a_law_by_the_page_is_right_everywhere(package, record_property):
    """The law of two invariants with C20 = 0 is Mooney-Rivlin's: in hex8, hex8-full and with an effect of strength zero its
    stress is that of the energy, and so with C20; the exponential law too.
    """
    off = json.loads(in_package(package, LAWS))
    record_property("off by", off)
    assert len(off) == 8
    assert max(off.values()) < 1e-9, off


SUM = """
import json
import numpy as np
from energies import derivative, series_energy, volume_energy
from support import YEOH, random_gradient
from explicitfe.fem.effects.material.fourth_yeoh import FourthYeoh
from explicitfe.fem.effects.material.third_yeoh import ThirdYeoh
from explicitfe.fem.solve import point

C10, C20, _, K = YEOH.constants()
rng = np.random.default_rng(15)
states = np.array([random_gradient(rng, 0.35) for _ in range(8)])
wanted = np.array([derivative(F, series_energy(C10, C20, C30=50.0, C40=20.0), volume_energy(K)) for F in states])
effects = (ThirdYeoh(C30_Pa=50.0), FourthYeoh(C40_Pa=20.0))
stress, _ = point.path(YEOH, effects, np.zeros(len(states)), states, [])
print(json.dumps(float(np.abs(stress - wanted).max() / np.abs(wanted).max())))
"""


def test_a_second_stiffening_effect_adds_up(package):
    """Beside ``third-yeoh`` the effect of the page gives the stress of both terms."""
    assert json.loads(in_package(package, SUM)) < 1e-9


TRUTH = {"C10": 300.0, "C20": 20.0, "C40": 6.0}
NOISE_SHARE, TOP_STRETCH, ROWS = 0.003, 2.2, 40
CLOSE = """
import json
from explicitfe.app.api.inverse import close_loop

if __name__ == "__main__":
    report = close_loop({data!r}, effects=("third-yeoh", "fourth-yeoh", "viscoelastic"), processes=1)
    print(json.dumps({{"verdict": report.verdict, "effects": report.effects, "sentence": report.sentence}}))
"""


def nominal_stress(stretch: np.ndarray) -> np.ndarray:
    """Of an incompressible bar whose sides are free [Pa]: P_zz - P_xx F_xx / F_zz of the energy with the fourth term."""
    energy = series_energy(TRUTH["C10"], TRUTH["C20"], C40=TRUTH["C40"])
    values = []
    for l in stretch:  # noqa: E741
        P = derivative(np.diag([l**-0.5, l**-0.5, l]), energy)
        values.append(P[2, 2] - P[0, 0] * l**-1.5)
    return np.array(values)


def dataset(folder: Path) -> Path:
    """Three pulls of one tissue with the fourth Yeoh term in it, with noise."""
    folder.mkdir()
    rng = np.random.default_rng(16)
    stretch = np.linspace(1.0, TOP_STRETCH, ROWS)
    truth = nominal_stress(stretch)
    sd = NOISE_SHARE * truth.max()
    text = 'format = "explicitfe-dataset/1"\nname = "pulls"\ntitle = "Pulls"\ntest = "tension"\n'
    text += f'[specimen]\nshape = "point"\n[noise]\nstress_sd_Pa = {sd:.6g}\nstretch_sd = 0.0\n'
    for k in range(3):
        rows = zip(np.linspace(0.0, 10.0, ROWS), stretch, truth + sd * rng.standard_normal(ROWS), strict=True)
        lines = "".join(f"{t:.9g},{l:.9g},{y:.9g}\n" for t, l, y in rows)  # noqa: E741
        (folder / f"pull-{k}.csv").write_text(f"time_s,stretch,nominal_stress_Pa\n{lines}", encoding="utf-8")
        text += f'[[curve]]\nid = "pull-{k}"\nfile = "pull-{k}.csv"\n'
    (folder / "dataset.toml").write_text(text, encoding="utf-8")
    return folder


def test_the_loop_names_the_effect(package, tmp_path):
    """Hidden in a dataset, the effect of the page is what ``close-loop`` names, not the third term and no relaxation."""
    data = dataset(tmp_path / "pulls")
    report: dict[str, Any] = json.loads(in_package(package, CLOSE.format(data=str(data))).splitlines()[-1])
    assert (report["verdict"], report["effects"]) == ("effect-found", ["fourth-yeoh"]), report
    assert "fourth Yeoh term" in report["sentence"]


FLOOR = """
import numpy as np
from explicitfe.platform.compiled.arrays import Floor, node_rows
from explicitfe.platform.compiled.jit import kernel
from explicitfe.fem.forces.floor import add_floor

def push(force, u, floor):
    add_floor(force, u, floor)

floor = Floor(np.array([0, 2]), np.array([0.001, 0.001]), np.array([50.0, 50.0]))
u = node_rows(np.array([[0.0, 0.0, -0.003], [0.0, 0.0, -0.003], [0.0, 0.0, 0.002]]))
force = np.zeros_like(u)
kernel(push)(force, u, floor)
print(*force[:3, 2])
"""


def test_the_force_pushes(package, tmp_path):
    """A node 3 mm down and 1 mm above the floor is pushed up by 50 N/m x 2 mm = 0.1 N; one not listed, or above, is not."""
    script = tmp_path / "floor.py"
    script.write_text(FLOOR, encoding="utf-8")  # what is kept on disk has to stand in a file
    printed = in_package(package, f"import runpy; runpy.run_path({str(script)!r})").split()
    assert np.array(printed, dtype=float) == pytest.approx([0.1, 0.0, 0.0], abs=1e-15)


def test_diffs_are_applied_in_order():
    """New lines stand where the block shows them, between lines that may be apart in the file."""
    text = "import a\nimport c\n\nTABLE = {\n    1,\n}\n"
    diff = "-import a\n+import a2\n+import b\n import c\n TABLE = {\n+    0,\n"
    assert edited(text, diff) == "import a2\nimport b\nimport c\n\nTABLE = {\n    0,\n    1,\n}\n"
    with pytest.raises(ValueError, match="import d"):
        edited(text, " import d\n+import e\n")
