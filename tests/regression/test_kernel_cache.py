"""Compiled kernels: kept on disk for the next process, never served stale, compiled once, and for vectors.

Numba's cache looks at a template's own file and at the kernel's name, so the name carries a digest of everything else that is
bound in (compiled/jit.py). The tests here edit a law between two bindings and look at what is computed.
"""

from __future__ import annotations

import errno
import importlib.util
import json
import os
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numba
import numpy as np
import pytest
from llvmlite.binding import get_host_cpu_features
from numba.core import caching
from support import ELEMENTS, ROOT, YEOH, block_mesh, floor_below, model_of, small_indentation, tongue

from explicitfe.fem.model.model import PrescribedMotion
from explicitfe.fem.solve.equilibrium import Relaxation
from explicitfe.fem.solve.kernels import kernels
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.platform.compiled import cache as compiled_cache
from explicitfe.platform.compiled import digest
from explicitfe.platform.compiled.jit import OPTIONS, bind
from explicitfe.platform.compiled.simd import WIDTH
from explicitfe.platform.errors import RunWarning
from explicitfe.simulate.anatomy.muscles import directed, line_pull
from explicitfe.simulate.scenario.transient import MuscleTable

pytestmark = pytest.mark.slow

law = None  # placeholder of the template below

LEAF = "from explicitfe.platform.compiled.jit import leaf\n\n"


def template(x):
    """A kernel of one line."""
    return law(x) + 1.0


LEAF = """
from explicitfe.platform.compiled.jit import leaf

def double(x):
    return 2.0 * x

helper = leaf(double)

@leaf
def law(x):
    return helper(x) * 10.0
"""

# A power of a constant is a function of Numba's own, whose name is a number that differs between processes.
PART_LAW = """
from explicitfe.platform.compiled.jit import leaf

@leaf
def helper(x):
    return 2.0 * x + max(x, 0.5) ** 9

@leaf
def law(x):
    return helper(x) * 10.0 - 8.0 * x ** 7
"""


def module_from(path: Path, text: str) -> ModuleType:
    """Write a source file and import it afresh under the same name, as after an edit."""
    path.write_text(text)
    spec = importlib.util.spec_from_file_location("edited_law", path)
    module = importlib.util.module_from_spec(spec)
    # not from a .pyc of the same second and size
    exec(compile(text, str(path), "exec"), module.__dict__)
    return module


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    """Machine code of these tests goes to a folder of its own."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path


EDITS = {
    "a constant": ("* 10.0", "* 100.0", 201.0),
    "an operation": ("* 10.0", "+ 10.0", 13.0),
    "what the law calls": ("2.0 * x", "3.0 * x", 31.0),
}


@pytest.mark.parametrize("edit", list(EDITS))
def test_an_edited_law_is_compiled_anew(edit, own_cache):
    """Binding another law source gives another name and what the new source computes; the same one gives the same name."""
    old, new, wanted = EDITS[edit]
    path = own_cache / "edited_law.py"
    first = bind(template, law=module_from(path, LEAF).law)
    assert first(1.0) == 21.0
    again = bind(template, law=module_from(path, LEAF).law)
    assert again.py_func.__qualname__ == first.py_func.__qualname__
    second = bind(template, law=module_from(path, LEAF.replace(old, new)).law)
    assert second(1.0) == wanted
    assert second.py_func.__qualname__ != first.py_func.__qualname__


def test_two_files_with_the_same_function_are_told_apart(own_cache):
    """The same name and the same byte code, but a global with another value in its file: another kernel."""
    text = "from explicitfe.platform.compiled.jit import leaf\nSCALE = {}\n\n@leaf\ndef law(x):\n    return SCALE * x\n"
    results, names = [], set()
    for scale in (2.0, 3.0):
        bound = bind(template, law=module_from(own_cache / f"law_{scale:.0f}.py", text.format(scale)).law)
        results.append(bound(1.0))
        names.add(bound.py_func.__qualname__)
    assert results == [3.0, 4.0]
    assert len(names) == 2


def test_what_a_factory_captures_is_told_apart(own_cache):
    """Laws made by one function differ only in what they captured: same file, same byte code, another kernel."""
    text = LEAF + "def make(k):\n    @leaf\n    def law(x):\n        return k * x\n    return law\n"
    module = module_from(own_cache / "factory.py", text)
    two, three = (bind(template, law=module.make(k)) for k in (2.0, 3.0))
    assert [two(1.0), three(1.0)] == [3.0, 4.0]
    assert two.py_func.__qualname__ != three.py_func.__qualname__


def test_an_inner_function_does_not_spoil_the_name(own_cache):
    """A name that carried an address, as the repr of an inner function's code does, would never hit the cache."""
    text = LEAF + "@leaf\ndef law(x):\n    inner = lambda y: 2.0 * y\n    return inner(x)\n"
    kept = [module_from(own_cache / "inner.py", text) for _ in range(2)]
    names = {bind(template, law=module.law).py_func.__qualname__ for module in kept}
    assert len(names) == 1


PROCESS = """
import sys
sys.path.insert(0, {folder!r})
import numba, template_file, edited_law
from explicitfe.platform.compiled.jit import bind
kernel = bind(template_file.template, law=edited_law.law)
print(kernel(1.0), sum(kernel.stats.cache_hits.values()), kernel.py_func.__qualname__)
"""


def in_a_process(code: str, cache: Path | None = None, package: Path = ROOT) -> str:
    environment = os.environ | {"PYTHONPATH": str(package), "PYTHONDONTWRITEBYTECODE": "1"}
    if cache is not None:
        environment["NUMBA_CACHE_DIR"] = str(cache)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, cwd=package, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_an_edited_helper_is_compiled_anew_in_the_next_process(tmp_path):
    """A law that calls a helper from another file, edited between two processes: the third process hits the cache again."""
    (tmp_path / "template_file.py").write_text("law = None\n\ndef template(x):\n    return law(x) + 1.0\n")
    (tmp_path / "edited_law.py").write_text(
        LEAF + "from helper_file import helper\n\n@leaf\ndef law(x):\n    return helper(x) * 10.0\n"
    )
    helper = LEAF + "@leaf\ndef helper(x):\n    return {} * x\n"
    code = PROCESS.format(folder=str(tmp_path))
    processes = []
    for factor in (2.0, 3.0, 3.0):
        (tmp_path / "helper_file.py").write_text(helper.format(factor))
        value, hits, name = in_a_process(code, tmp_path / "cache").split()
        processes.append((float(value), int(hits), name))
    assert [value for value, _, _ in processes] == [21.0, 31.0, 31.0]
    assert [hits for _, hits, _ in processes] == [0, 0, 1]
    assert processes[0][2] != processes[1][2] == processes[2][2]


OTHER_NUMBA = """
from numba.core import caching, codegen
holder, name = {missing}
known = getattr(holder, name)
delattr(holder, name)
from explicitfe.platform.compiled import jit
setattr(holder, name, known)
assert not jit.PART
import numpy as np
from explicitfe.platform.compiled.simd import WIDTH, load, square_root, store
@jit.leaf
def law(x):
    return square_root(x) * 0.1 + x
def template(values):
    store(values, 0, law(load(values, 0)))
    return law(2.0)
values = np.arange(1.0, WIDTH + 1.0)
print(jit.bind(template, law=law)(values), values.tolist())
"""


@pytest.mark.parametrize("missing", ["codegen, 'JITCodeLibrary'", "caching.IndexDataCacheFile, '_data_path'"])
def test_a_release_of_numba_without_an_internal_compiles_in_its_own_way(missing, tmp_path):
    """The same numbers, without the linking of this package; a whole run was compared to the bit by hand."""
    (tmp_path / "other_numba.py").write_text(OTHER_NUMBA.format(missing=missing))
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import other_numba"
    x = np.arange(1.0, WIDTH + 1.0)
    one, *all_values = (float(word.strip("[],")) for word in in_a_process(code, tmp_path / "cache").split())
    np.testing.assert_allclose([one, *all_values], [np.sqrt(2.0) * 0.1 + 2.0, *(np.sqrt(x) * 0.1 + x)], rtol=1e-15)


PARTS = """
import sys
sys.path.insert(0, {folder!r})
import template_file, edited_law
from explicitfe.platform.compiled.jit import bind
value = bind(template_file.{template}, law=edited_law.law)(1.0)
stats = [part.stats for part in (edited_law.law, edited_law.helper)]
print(value, *(sum(part.cache_hits.values()) for part in stats), *(sum(part.cache_misses.values()) for part in stats))
"""


@pytest.mark.parametrize("damaged", [False, True])
def test_another_kernel_loads_the_parts_that_it_has_in_common(damaged, tmp_path):
    """What a first kernel calls is loaded by a second one in the next process, or compiled again if the files are damaged."""
    kernels = "law = None\n\ndef first(x):\n    return law(x) + 1.0\n\ndef second(x):\n    return law(x) ** 2\n"
    (tmp_path / "template_file.py").write_text(kernels)
    (tmp_path / "edited_law.py").write_text(PART_LAW)
    cache = tmp_path / "cache"
    first, second = (PARTS.format(folder=str(tmp_path), template=name) for name in ("first", "second"))
    assert in_a_process(first, cache).split() == ["23.0", "0", "0", "1", "1"]
    if damaged:
        for file in cache.rglob("*.nbc"):
            content = bytearray(file.read_bytes())
            content[len(content) // 2] ^= 1
            file.write_bytes(content)
    hits = ["0", "0", "1", "1"] if damaged else ["1", "1", "0", "0"]
    assert in_a_process(second, cache).split() == ["484.0", *hits]


EFFECT = """
import numpy as np
from explicitfe.fem.effects.complete import complete
from explicitfe.fem.effects.material.third_yeoh import ThirdYeoh
from explicitfe.fem.forces.response import layout_of
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import point
law, effects = Yeoh(C10_Pa=191.5, C20_Pa=90.6), (ThirdYeoh(C30_Pa=500.0),)
stress = point.shear(law, effects, np.zeros(1), np.ones(1))[0]
stats = point._kernel("yeoh", layout_of(complete(effects))).stats
print(stress, sum(stats.cache_hits.values()))
"""


def test_an_edited_effect_is_never_served_stale(tmp_path):
    """In a copy of the package the file of an effect is edited between two processes: 2 (C10 + 2 C20 + 3 C30) in shear by 1,
    where I1_bar - 3 = 1, becomes 2 (C10 + 2 C20 + 6 C30); the third process finds the machine code of the second.
    """
    shutil.copytree(ROOT / "explicitfe", tmp_path / "explicitfe", ignore=shutil.ignore_patterns("__pycache__"))
    effect = tmp_path / "explicitfe" / "fem" / "effects" / "material" / "third_yeoh.py"
    answers = []
    for factor in ("3.0", "6.0", "6.0"):
        text = effect.read_text()
        effect.write_text(re.sub(r"\d\.0 \* c \* x \* x,", f"{factor} * c * x * x,", text))
        answers.append([float(word) for word in in_a_process(EFFECT, tmp_path / "cache", package=tmp_path).split()])
    slopes = [2.0 * (191.5 + 2.0 * 90.6 + factor * 500.0) for factor in (3.0, 6.0, 6.0)]
    assert [stress for stress, _ in answers] == pytest.approx(slopes, rel=1e-12)
    assert [hits for _, hits in answers] == [0, 0, 1]


def test_every_file_with_kernels_counts(tmp_path, monkeypatch):
    """An edit of any file that can reach machine code, in folders of folders too, gives every kernel another name."""
    copy = tmp_path / "explicitfe"
    shutil.copytree(ROOT / "explicitfe", copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(digest, "_PACKAGE", copy)
    names = set()
    edited = [
        "fem/effects/material/fibres.py",
        "fem/effects/effect.py",
        "fem/materials/yeoh.py",
        "fem/materials/two_invariants.py",
    ]
    edited += [
        "fem/elements/hex8.py",
        "fem/forces/response.py",
        "platform/compiled/simd.py",
        "fem/solve/step.py",
        "fem/solve/relax_step.py",
    ]
    for place in ("", *edited):
        if place:
            (copy / place).write_text((copy / place).read_text() + "# edited\n")
        digest._package_digest.cache_clear()
        names.add(bind(template, law=1.0).py_func.__qualname__)
    digest._package_digest.cache_clear()
    assert len(names) == 1 + len(edited)


def test_a_binding_that_changes_nothing_is_an_error():
    """A placeholder that the template does not read would leave the old law in place."""
    with pytest.raises(TypeError, match="lawn"):
        bind(template, lawn=1.0)


SECOND = """
import json
from support import block_mesh, floor_below, model_of, small_indentation
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.equilibrium import Relaxation
mesh = block_mesh((2, 2, 2))
simulation = Simulation(model_of(mesh, element={element!r}, bones=(floor_below(mesh),)))
seconds = simulation.compile() + Relaxation(small_indentation(element={element!r})).compile()
names = [name for name in simulation.kernels.__dataclass_fields__ if name != "known"]
stats = {{name: getattr(simulation.kernels, name).stats for name in names}}
counts = {{name: [sum(s.cache_hits.values()), sum(s.cache_misses.values())] for name, s in stats.items()}}
print(json.dumps({{"seconds": seconds, **counts}}))
"""


@pytest.mark.parametrize("element", ELEMENTS)
def test_the_next_process_does_not_compile(element, record_property):
    """What one process has compiled the next one loads: each kernel is one hit and no miss."""
    mesh = block_mesh((2, 2, 2))
    Simulation(model_of(mesh, element=element, bones=(floor_below(mesh),))).compile()
    Relaxation(small_indentation(element=element)).compile()
    path = f"import sys; sys.path.insert(0, {str(ROOT / 'tests')!r})\n"
    counts = json.loads(in_a_process(path + SECOND.format(element=element)))
    seconds = counts.pop("seconds")
    record_property("seconds", seconds)
    assert {*counts, "known"} == set(kernels("yeoh", element).__dataclass_fields__)
    assert all(hits_and_misses == [1, 0] for hits_and_misses in counts.values()), counts


@pytest.mark.parametrize("element", ELEMENTS)
def test_one_signature_per_kernel(element):
    """Every caller passes the same types, so each kernel is compiled once: an int for a float would be a second compile.

    Models with and without loads, following fibres and prescribed motion, at rest and not, through all that a simulation offers.
    """
    mesh, muscles = tongue().mesh, tongue().muscles
    lines = line_pull(mesh, muscles["GGp"], MuscleTable(name="GGp", force_N=1))
    loads = [directed(mesh, lines, direction) for direction in ("reference", "following")]
    moved = np.zeros(mesh.points.shape, dtype=np.float32)
    base = mesh.node_sets["jaw"]

    def still(times: np.ndarray) -> np.ndarray:
        u = np.zeros((len(times), len(base), 3))
        u.flags.writeable = False  # as np.broadcast_to gives
        return u

    motion = PrescribedMotion(base, still)
    for model in (
        model_of(mesh, YEOH, element=element),
        model_of(mesh, YEOH, element=element, motion=motion),
        model_of(mesh, YEOH, element=element, bones=(floor_below(mesh),)),
        model_of(mesh, YEOH, held=("jaw",), loads=(loads[0],), pulls=(loads[1],), alpha_per_s=40, element=element),
    ):
        simulation = Simulation(model, displacement=moved, velocity=moved)
        simulation.compile()
        dt = 0.5 * simulation.stable_limit(10)
        simulation.stable_bound()
        simulation.start(dt)
        simulation.advance(np.int32(3), np.float64(dt))
        simulation.snapshot()
        simulation.external_force()
        simulation.internal_force(np.asfortranarray(mesh.points * 1e-3))
        simulation.restore(simulation.restart_state())
    gravity = (0.0, 0.0, -9.81)
    for symmetry, friction, pull_down in (("sector", 0.0, (0.0, 0.0, 0.0)), ("quarter", 0.3, gravity)):
        body = Relaxation(small_indentation(element=element, symmetry=symmetry, gravity_m_s2=pull_down, friction=friction))
        body.compile()
        body.settle()
        body.press(np.float32(0.01))
        body.move(np.float64(1e-4))
        body.element_fields()
        body.contact_pressure()
        body.internal_force(body.displacement)
    compiled = kernels("yeoh", element)
    for name in set(compiled.__dataclass_fields__) - {"known"}:
        assert len(getattr(compiled, name).signatures) == 1, name


@pytest.mark.parametrize("element", ELEMENTS)
def test_the_force_kernel_is_vectorised(element, record_property):
    """On x86-64 with AVX the machine code of the forces works on whole registers: packed multiplications on xmm, ymm or zmm.

    An element takes some 500 multiplications, so a scalar kernel, whatever a compiler packs by itself, has few of these.
    Machine code from the cache cannot be looked at, so the same function is compiled here without it.
    """
    if platform.machine().lower() not in ("x86_64", "amd64"):
        pytest.skip(f"looks for registers of x86-64, this is {platform.machine()}")
    wide = "zmm" if get_host_cpu_features().get("avx512f", False) else "ymm"  # eight lanes are two registers of AVX2
    register = {2: "xmm", 4: "ymm", 8: wide}[WIDTH]
    simulation = Simulation(model_of(block_mesh((1, 1, 1)), element=element))
    simulation.compile()
    fresh = numba.jit(simulation.kernels.internal_force.py_func, **OPTIONS)
    fresh(simulation.state.u, np.zeros_like(simulation.state.u), simulation.blocks)
    (code,) = fresh.inspect_asm().values()
    packed = re.findall(rf"\tv(?:mul|fn?m(?:add|sub)\w+)pd\b[^\n]*%{register}", code)
    scalar = re.findall(r"\tv(?:mul|fn?m(?:add|sub)\w+)sd\b", code)
    record_property("packed", len(packed))
    record_property("scalar", len(scalar))
    assert len(packed) > 200
    assert len(scalar) < 0.1 * len(packed)


STORED_KERNEL = """
import sys
sys.path.insert(0, {folder!r})
import template_file, edited_law
from explicitfe.platform.compiled.jit import bind
kernel = bind(template_file.template, law=edited_law.law)
print(kernel(1.0), sum(kernel.stats.cache_hits.values()))
"""


@pytest.mark.parametrize("suffix", ["nbc", "nbi"])
def test_a_damaged_kernel_is_compiled_again(tmp_path, suffix):
    """A bit is flipped in the machine code or in the index: without a checksum LLVM ends the process or a pickle is executed."""
    (tmp_path / "template_file.py").write_text("law = None\n\ndef template(x):\n    return law(x) + 1.0\n")
    (tmp_path / "edited_law.py").write_text(LEAF)
    code = STORED_KERNEL.format(folder=str(tmp_path))
    cache = tmp_path / "cache"
    assert in_a_process(code, cache).split() == ["21.0", "0"]
    assert in_a_process(code, cache).split() == ["21.0", "1"]
    (file,) = cache.rglob(f"template_file.*.{suffix}")
    whole = file.read_bytes()
    for place in np.linspace(0, len(whole) - 1, 4).astype(int):
        file.write_bytes(whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :])
        assert in_a_process(code, cache).split() == ["21.0", "0"], place
        assert in_a_process(code, cache).split() == ["21.0", "1"], place
    file.write_bytes(whole[: len(whole) // 2])
    assert in_a_process(code, cache).split() == ["21.0", "0"]


def test_kernels_go_to_a_temporary_folder_where_nothing_else_can_be_written(tmp_path, monkeypatch):
    """Package and home folder both read-only: a note names the folder, and the next process loads from there."""
    monkeypatch.setattr(compiled_cache.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    writable = caching._CacheLocator.ensure_cache_path

    def ensure(locator):
        if not locator.get_cache_path().startswith(str(tmp_path)):
            raise PermissionError("read-only")
        writable(locator)

    monkeypatch.setattr(caching._CacheLocator, "ensure_cache_path", ensure)
    for function in (compiled_cache.temporary_folder, compiled_cache._warn):
        function.cache_clear()
    path = tmp_path / "edited_law.py"
    with pytest.warns(RunWarning, match=rf"stored in {tmp_path}/explicitfe-kernels-.*NUMBA_CACHE_DIR"):
        kernel = bind(template, law=module_from(path, LEAF).law)
    assert kernel(1.0) == 21.0
    again = bind(template, law=module_from(path, LEAF).law)
    assert again(1.0) == 21.0 and sum(again.stats.cache_hits.values()) == 1
    (folder,) = tmp_path.glob("explicitfe-kernels-*")
    assert folder.stat().st_mode & 0o777 == 0o700 and list(folder.rglob("*.nbc"))
    compiled_cache.temporary_folder.cache_clear()
    folder.chmod(0o777)  # another user could put files there
    assert compiled_cache.temporary_folder() != folder
    for function in (compiled_cache.temporary_folder, compiled_cache._warn):
        function.cache_clear()


def test_kernels_that_cannot_be_stored_are_used_all_the_same(own_cache, monkeypatch):
    """A full disk costs only the next compilation."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(caching.IndexDataCacheFile, "save", full)
    compiled_cache._warn.cache_clear()
    kernel = bind(template, law=module_from(own_cache / "edited_law.py", LEAF).law)
    with pytest.warns(RunWarning, match="cannot be stored in .*No space left on device"):
        assert kernel(1.0) == 21.0
