"""What a person sees first: a command says at once what it does, before any library that takes long to import is there."""

from __future__ import annotations

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest
from command import command
from support import ROOT

from explicitfe.app.cli.app import COMMANDS, GROUPS
from explicitfe.platform.errors import Stage
from explicitfe.platform.host.compilation import listening
from explicitfe.simulate.run.machine_code import make_ready

SLOW = ["numba", "scipy.interpolate", "scipy.spatial", "scipy.optimize", "h5py", "pyvista", "matplotlib", "meshio"]
# They are done within a second, imports and all, and say nothing before their answer.
QUICK = {"list.py"}


def printed_by(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_first_lists_wait_for_no_slow_library() -> None:
    code = f"""
import sys
from explicitfe.app.cli.execute import execute
for what in ("models", "scenarios", "datasets", "protocols"):
    execute(["list", what])
print("imported:", [name for name in {SLOW} if name in sys.modules])
"""
    shown = printed_by(code)
    assert shown.splitlines()[-1] == "imported: []"
    assert all(name in shown for name in ("tongue", "vowel-i", "gerard-2005"))


def test_words_come_before_the_imports() -> None:
    code = """
import os, sys
from explicitfe.app.cli.execute import execute
from explicitfe.app.view import progress
def say(self, words):
    print(words, "numpy" in sys.modules, "numba" in sys.modules, flush=True)
    os._exit(0)
progress._InLog.say = say
execute(["check", "missing.toml"])
"""
    assert printed_by(code) == "reading missing.toml False False\n"


@pytest.mark.parametrize("file", sorted((ROOT / "explicitfe/app/cli").glob("*.py")), ids=lambda path: path.name)
def test_a_command_imports_after_its_first_words(file: Path) -> None:
    """What a command's function imports of the package stands inside its ``with following(...)``."""
    functions = {function.__name__ for panel in COMMANDS.values() for function in panel.values()}
    functions |= {function.__name__ for groups in GROUPS.values() for _, inner in groups.values() for function in inner.values()}
    tree = ast.parse(file.read_text(encoding="utf-8"))
    for function in tree.body:
        if not isinstance(function, ast.FunctionDef) or function.name not in functions or file.name in QUICK:
            continue
        followed = {
            inner
            for block in ast.walk(function)
            if isinstance(block, ast.With) and "following(" in ast.unparse(block.items[0])
            for inner in ast.walk(block)
        }
        early = [node for node in ast.walk(function) if isinstance(node, ast.ImportFrom) and node not in followed]
        # the schema of scenarios takes half a second; nothing else does without words
        assert {str(node.module) for node in early} <= {"explicitfe.simulate.scenario.read"}, file.name


def test_no_flag_asks_for_a_value(capsys: pytest.CaptureFixture[str]) -> None:
    names = [[name] for panel in COMMANDS.values() for name in panel]
    names += [[group, name] for groups in GROUPS.values() for group, (_, inner) in groups.items() for name in inner]
    for words in [[], *names]:
        command([*words, "--help"])
        assert "<bool>" not in capsys.readouterr().out, words


KERNEL = """
import numba
@numba.njit(cache=True)
def thrice(x):
    return 3 * x
"""


def test_compiling_is_said_only_where_something_is_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first time it is compiled, the second time it is loaded from the disk."""
    (tmp_path / "kernel_to_load.py").write_text(KERNEL, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    module = importlib.import_module("kernel_to_load")
    reported: list[tuple[Stage, float]] = []

    class Small:
        def compile(self, progress) -> float:  # type: ignore[no-untyped-def]
            progress(0.0)
            assert module.thrice(2) == 6
            progress(1.0)
            return 0.0

    announced: list[str] = []
    with listening(announced.append):
        make_ready(Small(), lambda stage, share: reported.append((stage, share)), "small models")
        assert reported == [("load", 0.0), ("compile", 0.0), ("compile", 1.0)]
        reported.clear()
        module = importlib.reload(module)
        make_ready(Small(), lambda stage, share: reported.append((stage, share)), "small models")
    assert reported == [("load", 0.0), ("load", 1.0)]
    assert announced == ["small models"]
