"""What is said where a package of an extra is missing, and that the core runs without any of them."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from support import ROOT

from explicitfe.app.view.palette import new_figure, save
from explicitfe.platform.errors import InputError
from explicitfe.platform.host import extras
from explicitfe.results.files.folder import drawing

# Makes the packages of all extras impossible to find, as on a machine with the core alone.
WITHOUT_EXTRAS = """
import sys
from pathlib import Path
sys.modules |= dict.fromkeys(("pyvista", "vtk", "vtkmodules", "matplotlib", "imageio", "imageio_ffmpeg", "PIL", "pyarrow"))
"""


def test_the_sentence_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(extras.PACKAGES, "view", "no_such_package")
    assert not extras.has_extra("view")
    with pytest.raises(
        InputError,
        match=r'^drawing needs no_such_package, which is not installed: pip install "\.\[view\]" in its source folder$',
    ):
        extras.require("view", "drawing")


def test_every_package_of_an_extra_is_in_it() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for extra, package in extras.PACKAGES.items():
        assert any(line.startswith(package) for line in project["optional-dependencies"][extra])
        assert not any(line.startswith(package) for line in project["dependencies"])


def test_the_core_runs_without_extras(tmp_path: Path) -> None:
    """A run, its measures and its result; pictures are refused before anything is computed."""
    code = f"""{WITHOUT_EXTRAS}
sys.path.insert(0, {str(ROOT / "tests")!r})
from command import command
scenario = ["run", {str(ROOT / "scenarios/vowel-i.toml")!r}, "--out", {str(tmp_path)!r}]
settings = ["--set", "model.cells=[8,4,4]", "--set", "analysis.duration_ms=2"]
codes = [command([*scenario, *settings, "--plots"]), len([*Path({str(tmp_path)!r}).iterdir()])]
codes += [command([*scenario, *settings]), command(["measure", {str(tmp_path / "vowel-i.vtkhdf")!r}])]
print(codes)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.stdout.splitlines()[-1:] == ["[2, 0, 0, 0]"], done.stderr
    assert 'drawing pictures needs matplotlib, which is not installed: pip install ".[plots]"' in done.stderr


def test_numbers_are_written_where_nothing_can_be_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    warnings: list[str] = []
    with drawing(warnings):
        save(new_figure(1.0, 1.0), Path("never.png"))
    assert warnings == [
        "no pictures were drawn, because drawing needs matplotlib, which is not installed: "
        'pip install ".[plots]" in its source folder'
    ]
