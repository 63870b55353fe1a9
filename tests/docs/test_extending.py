"""docs/reference/extending.md: what the page says to write is written, and computes what its equations say.

Laws, effects and surfaces are files of a user, in a folder of their own beside the unchanged package. Measures and forces are
edits of the package, made in a copy of it. References are energies in numpy (tests/energies.py); 1e-9 of the largest stress,
which is K |J - 1| and rounded by some 100 eps.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from docs_blocks import blocks_of
from energies import derivative, series_energy
from support import ROOT

from explicitfe.fem.inputs import extensions

pytestmark = pytest.mark.slow

PAGE = (ROOT / "docs" / "reference" / "extending.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.M | re.S)
PLACE = re.compile(r"`(explicitfe/[\w/]+\.py)`")
OWN_FILE = re.compile(r"[Aa] file `(\w+\.py)`")


def edited(text: str, diff: str) -> str:
    """A file with a diff block applied: lines with `+` follow the last line that is shown, those with `-` go.

    Lines may be omitted between those that are shown; context and removed lines are looked for in order. New lines at the head of
    a block precede the first line that is shown.
    """
    lines, at = text.split("\n"), 0
    first: list[str] = []
    is_placed = False
    for line in diff.rstrip("\n").split("\n"):
        mark, content = line[:1], line[1:]
        if mark == "+" and not is_placed:
            first.append(content)
        elif mark == "+":
            lines.insert(at, content)
            at += 1
        else:
            place = lines.index(content, at)
            if mark == "-":
                del lines[place]
            lines[place:place] = first
            at = place + len(first) + (mark != "-")
            first, is_placed = [], True
    return "\n".join(lines)


@pytest.fixture(scope="module")
def user(tmp_path_factory) -> Path:
    """A folder of a user with the files that the page shows for it."""
    folder = tmp_path_factory.mktemp("user")
    for match in BLOCK.finditer(PAGE):
        language, block = match.groups()
        names = OWN_FILE.findall(PAGE[: match.start()].rstrip().rpartition("\n\n")[2])
        if language == "python" and names:
            (folder / names[-1]).write_text(block, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def package(tmp_path_factory) -> Path:
    """A copy of the package with the edits of the page."""
    folder = tmp_path_factory.mktemp("scratch")
    for name in ("explicitfe", "models", "scenarios"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for match in BLOCK.finditer(PAGE):
        language, block = match.groups()
        places = PLACE.findall(PAGE[: match.start()].rstrip().rpartition("\n\n")[2])
        if language == "python" and places:
            assert not (folder / places[-1]).exists(), f"{places[-1]} is there already; the page shows a new file"
            (folder / places[-1]).write_text(block, encoding="utf-8")
        elif language == "diff":
            path = folder / places[-1]
            path.write_text(edited(path.read_text(encoding="utf-8"), block), encoding="utf-8")
    return folder


def in_folder(folder: Path, code: str, package: Path = ROOT) -> str:
    """What a program prints that runs in a folder, with its files and a package."""
    script = folder / "program.py"
    script.write_text(code, encoding="utf-8")  # compiled code that is stored on disk belongs to a file
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(package), str(folder), str(ROOT / "tests")])}
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, env=environment, cwd=folder, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def program_with(words: str) -> str:
    (program,) = [block.text for block in blocks_of("reference/extending.md") if words in block.text]
    return program


def test_every_block_is_used():
    """Blocks are files, diffs, tables and programs: of each as many as the tests here run."""
    kinds = [block.language for block in blocks_of("reference/extending.md")]
    assert {kind: kinds.count(kind) for kind in set(kinds)} == {"python": 7, "diff": 6, "toml": 2}


def test_numbers_of_files():
    """A law and an effect change no file of the package, a measure two, a force five."""
    edits = [
        PLACE.findall(PAGE[: match.start()].rstrip().rpartition("\n\n")[2])[-1]
        for match in BLOCK.finditer(PAGE)
        if match[1] == "diff"
    ]
    measure = {place for place in edits if "/measure/" in place}
    assert len(measure) == 2 and len(set(edits) - measure) == 4  # and the new file of the force


def test_the_response_at_a_point(user):
    """P = 2 w (l - l^-2), w = mu / 2 exp(b (I1 - 3)), but for what J - 1 = p / K leaves: 1 %."""
    printed = np.array(in_folder(user, program_with("point.uniaxial")).strip("[] \n").split(), dtype=float)
    stretch = np.linspace(1.0, 1.5, 6)
    slope = 0.5 * 2074.0 * np.exp(stretch**2 + 2.0 / stretch - 3.0)
    assert printed == pytest.approx(2.0 * slope * (stretch - stretch**-2), rel=0.01, abs=1e-6)


def test_a_scenario_runs_with_the_law(user):
    assert in_folder(user, program_with("from demiray import Demiray\n\nstiff")).split() == ["finished"]


SCENARIO = """
import fourth_yeoh, demiray
from explicitfe import InputError
from explicitfe.simulate.scenario.read import read_scenario
law = 'model.material={{ law = "demiray", {constant} = 2074.0, b = 1.0 }}'
try:
    scenario, _ = read_scenario({path!r}, [law, 'effects.fourth-yeoh={{ C40_Pa = 20.0 }}'])
    print(scenario.model.material.law, [type(effect).__name__ for effect in scenario.effects.chosen])
except InputError as error:
    print(error)
"""


def test_scenarios_take_the_law_and_the_effect(user):
    """As settings; a wrong constant is refused with a sentence that names the law's own."""
    path = str(ROOT / "scenarios" / "vowel-i.toml")
    assert in_folder(user, SCENARIO.format(constant="mu_Pa", path=path)).split() == ["demiray", "['FourthYeoh']"]
    assert "mu_Pa" in in_folder(user, SCENARIO.format(constant="mu", path=path))


LATE = """
import explicitfe as fe
fe.check("vowel-i")
try:
    import demiray
except fe.InputError as error:
    print(error)
"""


def test_a_law_that_comes_too_late_is_refused(user):
    assert "before the first scenario is read" in in_folder(user, LATE)


ENTRY = """
from importlib.metadata import EntryPoint
from explicitfe.fem.inputs import extensions
extensions.entry_points = lambda group: [EntryPoint("demiray", "demiray", group)]
from explicitfe.simulate.scenario.read import read_scenario
scenario, _ = read_scenario({path!r}, ['model.material={{ law = "demiray", mu_Pa = 2074.0, b = 1.0 }}'])
print(scenario.model.material.law)
"""


def test_an_installed_extension_is_found(user):
    """The entry point of the page: what installed packages name is imported before scenarios are read."""
    assert tomllib.loads(program_with("entry-points"))["project"]["entry-points"] == {extensions.GROUP: {"demiray": "demiray"}}
    assert in_folder(user, ENTRY.format(path=str(ROOT / "scenarios" / "vowel-i.toml"))).split() == ["demiray"]


def test_an_extension_that_exits_and_prints(user):
    """It neither ends the command without a word, nor writes into its output."""
    (user / "leaving.py").write_text("import sys\nprint('hello')\nsys.exit(0)\n", encoding="utf-8")
    found, _, use = ENTRY.replace('"demiray", "demiray"', '"mine", "leaving"').partition("from explicitfe.simulate")
    code = f"{found}try:\n    from explicitfe.simulate{use.partition(chr(10))[0]}\nexcept Exception as error:\n    print(error)\n"
    assert in_folder(user, code).strip() == "the extension mine (leaving) cannot be imported: SystemExit(0)."


def test_the_bone_is_touched(user):
    """The plate of the page above the blade of the tongue: a run with the superior longitudinal presses on it."""
    in_folder(user, program_with("meshio.write"))
    table = program_with("[[bone]]")
    text = (ROOT / "scenarios" / "alveolar-t.toml").read_text(encoding="utf-8")
    (user / "retained.toml").write_text(text + "\n" + table, encoding="utf-8")
    code = "import explicitfe as fe\nended = fe.run('retained.toml', settings={'model.resolution': 'coarse'})\n"
    code += "with fe.open_result(ended) as result:\n"
    code += "    print(sorted(result.bones), result.history('contact_plate_force')[:, 2].min())"
    *bones, force_N = in_folder(user, code).replace("[", "").replace("]", "").replace(",", "").split()
    assert "'plate'" in bones and float(force_N) < 0.0


RUN = """
import explicitfe as fe
print(fe.run("vowel-i", settings={"model.resolution": "coarse", "analysis.duration_ms": 20}).path)
"""
MEASURE = """
import numpy as np
import explicitfe as fe
with fe.open_result({path!r}) as result:
    tip = result.probe("tip")
print(fe.measure({path!r}).path_mm["tip"], 1e3 * np.linalg.norm(np.diff(tip, axis=0), axis=1).sum())
"""


def test_the_measure_is_printed(package, tmp_path):
    """Of a result of the package as it is: a copy would compile all kernels again."""
    path = str(tmp_path / in_folder(tmp_path, RUN).strip())
    measured, expected = in_folder(package, MEASURE.format(path=path), package).split()
    assert float(measured) == pytest.approx(float(expected), rel=1e-12) and float(measured) > 0.1


LAWS = """
import json
import numpy as np
from demiray import Demiray
from isihara import Isihara
from energies import derivative, invariants, series_energy, volume_energy
from support import block_mesh, model_of, random_gradient, random_rotation
from explicitfe.fem.effects.material.third_yeoh import ThirdYeoh
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


def test_a_law_by_the_page_is_right_everywhere(user, record_property):
    """The law of two invariants with C20 = 0 is Mooney-Rivlin's: in hex8, hex8-full and with an effect of strength zero its
    stress is that of the energy, and so with C20; the exponential law too.
    """
    off = json.loads(in_folder(user, LAWS))
    record_property("off by", off)
    assert len(off) == 8
    assert max(off.values()) < 1e-9, off


SUM = """
import json
import numpy as np
from fourth_yeoh import FourthYeoh
from energies import derivative, series_energy, volume_energy
from support import YEOH, random_gradient
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


def test_a_second_stiffening_effect_adds_up(user):
    """Beside ``third-yeoh`` the effect of the page gives the stress of both terms."""
    assert json.loads(in_folder(user, SUM)) < 1e-9


TRUTH = {"C10": 300.0, "C20": 20.0, "C40": 6.0}
NOISE_SHARE, TOP_STRETCH, ROWS = 0.003, 2.2, 40
CLOSE = """
import json
import fourth_yeoh
from explicitfe import close_loop

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


def test_the_loop_names_the_effect(user, tmp_path):
    """Hidden in a dataset, the effect of the page is what ``close-loop`` names, not the third term and no relaxation."""
    data = dataset(tmp_path / "pulls")
    report: dict[str, Any] = json.loads(in_folder(user, CLOSE.format(data=str(data))).splitlines()[-1])
    assert (report["verdict"], report["effects"]) == ("effect-found", ["fourth-yeoh"]), report
    assert "fourth Yeoh term" in report["sentence"]


FLOOR = """
import numpy as np
import explicitfe as fe
mesh = fe.box(cells=(2, 2, 2), size_m=(0.01, 0.01, 0.01))
height = mesh.points[:, 2].min() - 0.0005
law = fe.Yeoh(C10_Pa=2e5, C20_Pa=0.0)
weight = fe.gravity_load(mesh, law, (0.0, 0.0, -9.81))
model = fe.Model(mesh, law, held=np.zeros((mesh.node_count, 3), bool), loads=(weight,), alpha_per_s=60.0, floor=(height, 20.0))
body = fe.Simulation(model)
largest = 0.0
for sample in fe.Transient(body, duration_s=0.6).samples(every_s=0.01):
    e = sample.energies
    largest = max(largest, abs(e[:3].sum() + e[4:].sum() - e[3]))
print(sample.displacement[:, 2].min(), np.abs(sample.velocity).max(), body.external_force()[:, 2].sum(), largest)
"""


def test_the_force_holds_a_body(package):
    """A stiff cube of 1 g falls 0.5 mm onto the floor and comes to rest on its 9 lower nodes.

    There m g = 9 k d, d = 1040e-6 x 9.81 / (9 x 20) = 57 micrometres below the floor; the external forces add up to zero, and the
    energy balance closes to rounding of its terms.
    """
    lowest, speed, net_N, imbalance = map(float, in_folder(package, FLOOR, package).split())
    depth = 1040e-6 * 9.81 / (9 * 20.0)
    assert lowest == pytest.approx(-(0.0005 + depth), rel=1e-2)
    assert speed < 1e-4 and abs(net_N) < 1e-4
    assert imbalance < 1e-9


def test_diffs_are_applied_in_order():
    """New lines stand where the block shows them, between lines that may be apart in the file."""
    text = "import a\nimport c\n\nTABLE = {\n    1,\n}\n"
    diff = "-import a\n+import a2\n+import b\n import c\n TABLE = {\n+    0,\n"
    assert edited(text, diff) == "import a2\nimport b\nimport c\n\nTABLE = {\n    0,\n    1,\n}\n"
    with pytest.raises(ValueError, match="import d"):
        edited(text, " import d\n+import e\n")
