"""The architecture: imports point to lower layers only, and some things are done in one place only.

Read from the source with ``ast``; nothing is imported. A new module has to be given its place in ``RANKS``.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from support import ROOT

PACKAGE = ROOT / "explicitfe"

# Low to high, by wing. A unit is a folder of a wing, or a module at the top of the package or of a wing; units of one rank are
# siblings and do not import each other.
WINGS = {
    "platform": [{"errors"}, {"compiled", "host"}],
    "fem": [
        {"mesh", "materials"},
        {"elements", "bones", "effects"},
        {"inputs", "forces"},
        {"tangent"},
        {"model"},
        {"solve"},
        {"reduced"},
    ],
    "results": [{"acoustics", "documents"}, {"files"}, {"measure"}],
    "simulate": [{"scenario", "meshes"}, {"anatomy"}, {"run"}, {"sweep"}],
    "inverse": [{"measured"}, {"predict"}, {"identify"}, {"close_loop"}],
    "app": [{"view"}, {"api", "tools"}, {"verify"}],
}
TOP = [{"__init__"}, {"app.cli"}, {"__main__"}]
RANKS = [{f"{wing}.{room}" for room in rooms} for wing, ranks in WINGS.items() for rooms in ranks] + TOP
RANK = {unit: rank for rank, units in enumerate(RANKS) for unit in units}
MOST_ARROWS_BETWEEN_WINGS = 20
# Reading, measuring and drawing a result must not need the mechanics.
PLATFORM = {"platform.errors", "platform.host"}
ONLY = {
    "results.acoustics": PLATFORM,
    "results.documents": PLATFORM | {"fem.mesh"},
    "results.files": PLATFORM | {"fem.mesh", "results.documents"},
    "results.measure": PLATFORM | {"fem.mesh", "results.acoustics", "results.documents", "results.files"},
    "app.view": PLATFORM | {"fem.mesh", "results.acoustics", "results.documents", "results.files", "results.measure"},
}
LAZY = ("pyvista", "matplotlib", "meshio", "jinja2", "pyarrow", "pandas")


def name_of(path: Path) -> str:
    """Dotted name of a module inside the package; a folder's __init__ has the folder's name."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" and len(parts) > 1 else parts)


MODULES = {name_of(path): path for path in sorted(PACKAGE.rglob("*.py"))}
TREES = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in MODULES.items()}


def unit_of(module: str) -> str:
    """Folder of a wing, such as "fem.mesh"; "__init__" and "__main__" of the package; a wing for its own ``__init__``."""
    return ".".join(module.split(".")[:2])


def imports(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Absolute dotted names that a tree imports, with the line; ``from a import b`` gives a.b."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: write absolute imports, they show the layer"
            yield from ((f"{node.module}.{alias.name}", node.lineno) for alias in node.names)


def inside(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Modules of the package that a tree imports, with the line."""
    for name, line in imports(tree):
        if name.split(".")[0] != "explicitfe":
            continue
        module = name.removeprefix("explicitfe").lstrip(".")
        while module and module not in MODULES:
            module = module.rpartition(".")[0]  # the last part is a function or a class
        yield module or "__init__", line


def at_import_time(tree: ast.Module) -> ast.Module:
    """The tree without the bodies of functions and without ``if TYPE_CHECKING``: what runs when it is imported."""

    class Strip(ast.NodeTransformer):
        def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
            return None

        visit_AsyncFunctionDef = visit_FunctionDef

        def visit_If(self, node: ast.If) -> ast.AST | None:
            if "TYPE_CHECKING" in ast.unparse(node.test):
                return None
            return self.generic_visit(node)

    return Strip().visit(ast.parse(ast.unparse(tree)))


def violations(module: str, tree: ast.AST) -> list[str]:
    """Sentences about the imports of a module that do not point down."""
    source = unit_of(module)
    wrong = []
    for target_module, line in inside(tree):
        target = unit_of(target_module)
        if target in (source, source.split(".")[0]):
            continue
        allowed = target in ONLY[source] if source in ONLY else RANK[target] < RANK[source]
        if not allowed:
            wrong.append(f"{module}:{line} imports {target_module}")
    return wrong


def test_every_module_has_a_place():
    """Every module of the package belongs to a unit of the table, and every unit of the table exists."""
    assert {unit_of(module) for module in MODULES} == set(RANK) | set(WINGS)


def test_the_wings_are_empty_folders():
    """The ``__init__`` of a wing imports nothing, so that a part of it does not load the others."""
    assert not [wing for wing in WINGS if list(imports(TREES[wing]))]


def test_few_arrows_between_wings():
    pairs = {(module.split(".")[0], target.split(".")[0]) for module, tree in TREES.items() for target, _ in inside(tree)}
    arrows = {(source, target) for source, target in pairs if source != target and {source, target} <= set(WINGS)}
    assert len(arrows) <= MOST_ARROWS_BETWEEN_WINGS, arrows


@pytest.mark.parametrize("module", list(MODULES))
def test_imports_point_down(module):
    assert not violations(module, TREES[module])


def test_no_circle():
    """The graph of all imports, those inside functions too, has no circle, also not inside a folder."""
    graph = {module: {target for target, _ in inside(tree)} - {module} for module, tree in TREES.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"imports in a circle: {' -> '.join(error.args[1])}")


def test_the_check_sees_what_it_should():
    """The check reports imports that point up, to a sibling or past ONLY, also inside functions."""
    up = "def f():\n    from explicitfe.fem.solve.simulation import Simulation\n"
    assert violations("fem.forces.contact", ast.parse(up)) == ["fem.forces.contact:2 imports fem.solve.simulation"]
    across = "from explicitfe.simulate.run import run"
    assert violations("fem.materials.yeoh", ast.parse(across)) == ["fem.materials.yeoh:1 imports simulate.run.run"]
    assert violations("results.files.reader", ast.parse("import explicitfe.platform.compiled.simd")) == [
        "results.files.reader:1 imports platform.compiled.simd"
    ]
    assert violations("fem.forces.internal", ast.parse("from explicitfe.fem.elements.hex8 import MODES")) == []
    late = "import numpy\nif TYPE_CHECKING:\n    import pyvista\ndef f():\n    import meshio\n"
    assert [name for name, _ in imports(at_import_time(ast.parse(late)))] == ["numpy"]


def test_the_statistics_know_no_tissue():
    """They serve any system of measured series: beside each other they know errors, numbers, and how a parameter is sought."""
    known = {"platform.errors", "inverse.close_loop.thresholds", "fem.effects.effect"}
    for module, tree in TREES.items():
        if module.startswith("inverse.close_loop.statistics."):
            others = {target for target, _ in inside(tree) if not target.startswith("inverse.close_loop.statistics")}
            assert others <= known, module
            sought = {name for name, _ in imports(tree) if name.startswith("explicitfe.fem.effects.")}
            assert sought <= {"explicitfe.fem.effects.effect.Sought"}, module


def test_only_jit_compiles():
    """numba is imported where functions are compiled, linked and stored, in what teaches it vectors, and in what watches it."""
    users = {module for module, tree in TREES.items() if any(n.split(".")[0] == "numba" for n, _ in imports(tree))}
    compiling = {"cache", "digest", "jit", "linking", "pieces"}
    compiled = {f"platform.compiled.{name}" for name in compiling | {"choose", "simd", "simd_lookup", "threads"}}
    assert users == compiled | {"platform.host.code_cache"}
    compilers = {"jit", "njit", "vectorize", "guvectorize", "jitclass", "cfunc", "stencil"}
    for node in ast.walk(TREES["platform.compiled.simd"]):
        assert not (isinstance(node, ast.Attribute) and node.attr in compilers), f"simd.py:{node.lineno}"
        assert not (isinstance(node, ast.Name) and node.id in compilers), f"simd.py:{node.lineno}"


def test_only_results_reads_and_writes_hdf5():
    users = {unit_of(m) for m, tree in TREES.items() if any(n.split(".")[0] == "h5py" for n, _ in imports(tree))}
    assert users == {"results.files"}


@pytest.mark.parametrize("library", LAZY)
def test_slow_libraries_are_imported_where_they_are_used(library):
    """They are imported inside functions only, so that nobody waits for a library without using it; and they are used at all."""
    for module, tree in TREES.items():
        early = [line for name, line in imports(at_import_time(tree)) if name.split(".")[0] == library]
        assert not early, f"{module} imports {library} when it is imported"
    assert any(name.split(".")[0] == library for tree in TREES.values() for name, _ in imports(tree))


def test_no_test_names_a_path_of_one_machine():
    """Tests find files from their own place or in a temporary folder."""
    roots = "|".join(["work", "home", "tmp", "root", "mnt", "opt", "Users", "var"])
    pattern = re.compile(rf"""["' =(](/({roots})/|[A-Z]:\\\\)""")
    assert pattern.search('open("' + "/ho" + 'me/me/file")')
    for path in sorted((ROOT / "tests").rglob("*.py")):
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            assert not pattern.search(line), f"{path.name}:{number}: {line.strip()}"


def test_the_command_starts_without_numpy():
    """Then the command can still set the number of threads of the linear algebra, and answers ``--help`` at once."""
    code = "import sys, explicitfe.app.cli.execute; print('numpy' in sys.modules, 'numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.split() == ["False", "False"]


def test_the_finite_elements_load_nothing_else():
    """``explicitfe.fem`` is a library of its own: its solvers load no other wing but ``platform``."""
    code = "import sys, explicitfe.fem.solve.transient, explicitfe.fem.solve.equilibrium, explicitfe.fem.inputs.specimen\n"
    code += "print(*sorted({name.split('.')[1] for name in sys.modules if name.startswith('explicitfe.')}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.split() == ["fem", "platform"]
