"""The wheel holds all that a user needs who has nothing else."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest
from support import ROOT


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a wheel of the working tree installs."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("explicitfe-*-py3-none-any.whl")
    with ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def test_every_file_of_the_package_is_in_it(unpacked: Path) -> None:
    """The package, and models and scenarios inside it; compiled files of this machine are not."""
    files = {path.relative_to(unpacked).as_posix() for path in unpacked.rglob("*") if path.is_file()}
    tracked = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False).stdout.split()
    if not tracked:
        pytest.skip("not a git checkout: what belongs to the package cannot be told")
    for name in tracked:
        if name.startswith("explicitfe/"):
            assert name in files
        if name.startswith(("models/", "scenarios/")):
            assert f"explicitfe/_data/{name}" in files
    assert not [name for name in files if "__pycache__" in name or name.endswith((".nbi", ".nbc"))]


def test_it_works_on_its_own(unpacked: Path, tmp_path: Path) -> None:
    """From the unpacked wheel alone, in another folder: shipped scenarios are listed and checked."""
    code = f"""
import sys
sys.path[:] = [{str(unpacked)!r}, *(entry for entry in sys.path if entry not in ("", {str(ROOT)!r}))]
import explicitfe
assert explicitfe.__file__.startswith({str(unpacked)!r}), explicitfe.__file__
from explicitfe.app.cli.execute import execute
sys.exit(execute(["list", "scenarios"]))
"""
    done = subprocess.run([sys.executable, "-P", "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "vowel-i" in done.stdout
