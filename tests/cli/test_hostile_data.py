"""Data of others are data: their texts run nowhere, nothing reaches a network, and foreign machine code is not loaded."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from command import command
from identify_cases import write_homogeneous
from support import ROOT

from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.solve import point

pytestmark = pytest.mark.slow

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
# Each would leave a mark on the page if it ran.
MARK = "document.documentElement.dataset.owned=1"
SCRIPT = f"<script>{MARK}</script>"
IMAGE = f"<img src=x onerror={MARK}>"
BROKEN_OUT = f'">\'><svg onload="{MARK}">'
# Appended to the page by the test: scripts do run in this browser, and it reads what a person sees.
WITNESS = """<script>document.documentElement.dataset.witness = JSON.stringify(
{text: document.body.innerText, title: document.title, owned: document.documentElement.dataset.owned || null,
 scripts: document.scripts.length, images: [...document.images].map(image => image.src.slice(0, 15))})</script>"""


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a dataset whose texts are all hostile."""
    folder = tmp_path_factory.mktemp("hostile")
    stretch = np.linspace(1.0, 0.8, 8)
    stress = point.uniaxial(Yeoh(C10_Pa=500.0, C20_Pa=200.0), (), np.zeros(len(stretch)), stretch)
    data = write_homogeneous(folder / "data", "compression", "stretch,nominal_stress_Pa", stretch, stress, "stress_sd_Pa = 1.0")
    file = data / "dataset.toml"
    text = file.read_text(encoding="utf-8").replace("Made by the simulator", f"title {SCRIPT}")
    for key in ("source", "license", "notes"):
        text = text.replace("test =", f"{key} = {json.dumps(f'{key} {SCRIPT}{BROKEN_OUT}')}\ntest =", 1)
    assert text.count('id = "one"') == 1
    text = text.replace('id = "one"', f"id = {json.dumps(f'id {IMAGE}')}\nconstants = {json.dumps(f'constants {SCRIPT}')}")
    text += f"group = {json.dumps(f'group {IMAGE}')}\n"
    text += f"[curve.conditions]\n{json.dumps(IMAGE)} = {json.dumps(f'condition {SCRIPT}')}\n"
    text += f"[[curve]]\nid = {json.dumps(f'other {IMAGE}')}\nfile = 'other.csv'\n"
    text += f"[curve.conditions]\ndefect = {json.dumps(f'defect {SCRIPT}')}\n"
    shutil.copy(data / "one.csv", data / "other.csv")
    file.write_text(text, encoding="utf-8")
    assert command(["close-loop", str(data), "--out", str(folder / "report"), "--json", "--max-effects", "0"]) in (0, 3)
    return folder / "report" / "report.html"


def test_texts_of_a_dataset_stand_on_the_page_as_text(report: Path) -> None:
    page = report.read_text(encoding="utf-8")
    for tag in ("<script", "<svg onload", "<img src=x", "<iframe", "<link"):
        assert tag not in page
    assert "&lt;script&gt;" in page and "&lt;img src=x" in page
    assert not re.search(r"https?:", page)


@pytest.mark.skipif(CHROMIUM is None, reason="needs chromium, in which the page is opened")
def test_no_script_of_a_dataset_runs_in_a_browser(report: Path, tmp_path: Path) -> None:
    assert CHROMIUM is not None
    page = tmp_path / "page.html"
    text = report.read_text(encoding="utf-8")
    assert text.count("</body>") == 1
    # The page forbids all scripts; the witness would be one of them. Without that policy escaping alone has to hold.
    text, policies = re.subn(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", text)
    assert policies == 1
    page.write_text(text.replace("</body>", f"{WITNESS}</body>"), encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-extensions", "--disable-background-networking"]
    options += [f"--user-data-dir={tmp_path / 'profile'}", "--host-resolver-rules=MAP * ~NOTFOUND"]
    words = [CHROMIUM, *options, "--dump-dom", page.as_uri()]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=True)
    (witness,) = re.findall(r'data-witness="([^"]*)"', done.stdout)
    seen = json.loads(witness.replace("&quot;", '"').replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&"))
    assert seen["owned"] is None and "data-owned" not in done.stdout
    assert seen["scripts"] == 1  # the witness itself
    assert not seen["images"]  # charts of the page are drawn in it
    for text in (f"id {IMAGE}", f"other {IMAGE}", f"defect {SCRIPT}"):
        assert text in seen["text"]


NETWORK_EVENTS = ("socket.connect", "socket.getaddrinfo", "socket.gethostbyname", "socket.sendto", "socket.bind")
NO_NETWORK = f"""
import sys
def refuse(event, arguments):
    if event in {NETWORK_EVENTS} and getattr(arguments[0], "family", None) != 1:  # 1: within this machine
        raise RuntimeError(f"the network was asked for: {{event}} {{arguments}}")
sys.addaudithook(refuse)
"""
_refusing: list[bool] = []


def _refuse(event: str, arguments: tuple[object, ...]) -> None:
    if _refusing and event in NETWORK_EVENTS:
        raise RuntimeError(f"the network was asked for: {event} {arguments}")


@pytest.fixture
def no_network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Every use of the network is an error, in this process and in those that it starts."""
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "sitecustomize.py").write_text(NO_NETWORK, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "site"))
    sys.addaudithook(_refuse)  # it cannot be taken away, only be told to look away
    _refusing.append(True)
    yield
    _refusing.clear()


def test_a_run_a_report_and_pictures_need_no_network(
    tmp_path: Path, no_network: None, capsys: pytest.CaptureFixture[str]
) -> None:
    def ask() -> None:
        import socket

        socket.getaddrinfo("localhost", 80)

    with pytest.raises(RuntimeError, match="the network was asked for"):
        ask()
    child = [sys.executable, "-c", "import socket; socket.getaddrinfo('localhost', 80)"]
    assert b"the network was asked for" in subprocess.run(child, capture_output=True).stderr

    settings = ["--set", "model.edge_size_mm=3", "--set", "analysis.forces_N=[0.05]"]
    words = ["run", str(ROOT / "scenarios/indentation-rear.toml"), "--out", str(tmp_path / "out"), "--plots", "--json", *settings]
    assert command(words) == 0, capsys.readouterr().err
    summary = json.loads(capsys.readouterr().out)
    assert len(summary["plots"]) == 2
    assert command(["inspect", summary["result"], "--json"]) == 0
    stretch = np.linspace(1.0, 0.8, 8)
    stress = point.uniaxial(Yeoh(C10_Pa=500.0, C20_Pa=200.0), (), np.zeros(len(stretch)), stretch)
    data = write_homogeneous(tmp_path / "data", "compression", "stretch,nominal_stress_Pa", stretch, stress, "stress_sd_Pa = 1.0")
    assert command(["close-loop", str(data), "--out", str(tmp_path / "report"), "--max-effects", "0"]) == 0
    assert command(["identify", str(data), "--out", str(tmp_path / "fit")]) == 0


@pytest.mark.skipif(os.name == "nt", reason="folders have owners and permissions on Unix")
@pytest.mark.parametrize("mode", [0o777, 0o1777, 0o702])
def test_a_cache_that_others_can_write_is_refused(
    mode: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Numba would unpickle, and so run, what they put there."""
    cache = tmp_path / "cache"
    cache.mkdir()
    cache.chmod(mode)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
    assert command(["list", "models", "--json"]) == 2
    error = json.loads(capsys.readouterr().out)["failure"]
    assert error["kind"] == "input"
    assert str(cache) in error["message"] and "chmod" in error["message"] and "NUMBA_CACHE_DIR" in error["message"]
    cache.chmod(0o700)
    assert command(["list", "models", "--json"]) == 0
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "not there yet"))
    assert command(["list", "models", "--json"]) == 0


def test_marks_of_the_terminal_in_texts_are_text(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A title that reads like the markup of rich neither colours the tables nor breaks them."""
    mark = "[/red] [bold]mark \\"
    stretch = np.linspace(1.0, 0.8, 8)
    stress = point.uniaxial(Yeoh(C10_Pa=500.0, C20_Pa=200.0), (), np.zeros(len(stretch)), stretch)
    data = write_homogeneous(tmp_path / "data", "compression", "stretch,nominal_stress_Pa", stretch, stress, "stress_sd_Pa = 1.0")
    file = data / "dataset.toml"
    text = file.read_text(encoding="utf-8").replace('"Made by the simulator"', json.dumps(mark))
    curve = f"id = {json.dumps(mark.strip(chr(92)).replace('/', ''))}\nconstants = {json.dumps(mark)}\ngroup = {json.dumps(mark)}"
    file.write_text(text.replace('id = "one"', curve), encoding="utf-8")
    (tmp_path / "run").mkdir()
    scenario = tmp_path / "run" / "[bold]punch.toml"
    scenario.write_bytes((ROOT / "scenarios/indentation-rear.toml").read_bytes())
    settings = ["--set", "model.edge_size_mm=3", "--set", "analysis.forces_N=[0.05]", "--set", f"title={json.dumps(mark)}"]
    result = tmp_path / "out" / "[bold]punch.vtkhdf"
    loop = str(tmp_path / "loop")
    for words in (
        ["identify", str(data), "--out", str(tmp_path / "fit[bold]")],
        ["close-loop", str(data), "--out", loop, "--max-effects", "0"],
        ["predict", str(data), "--model", f"{loop}/model.toml", "--out", str(tmp_path / "predicted")],
        ["check", str(scenario), *settings],
        ["run", str(scenario), *settings, "--out", str(result.parent)],
        ["inspect", str(result)],
    ):
        capsys.readouterr()
        assert command(words) == 0, capsys.readouterr().err
        shown = capsys.readouterr().out
        assert "[bold]" in shown.replace("\n", ""), words
