"""What the package must never do with what others give it: run it, unpickle it, hand it to a shell, or talk to a network.

Read from the source with ``ast``; nothing is imported. Machine code that Numba keeps on disk holds pickles, which only Numba
reads (docs/reference/performance.md says where, and who may write there).
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from support import ROOT
from test_layers import MODULES, TREES, imports

# They make objects or code out of bytes, or reach other machines.
NEVER_IMPORTED = {
    *("pickle", "_pickle", "dill", "cloudpickle", "joblib", "shelve", "marshal", "jsonpickle", "dbm", "yaml", "code", "codeop"),
    *("socket", "socketserver", "ssl", "http", "urllib", "urllib3", "ftplib", "smtplib", "imaplib", "poplib", "telnetlib"),
    *("xmlrpc", "requests", "aiohttp", "httpx", "websockets", "paramiko", "webbrowser", "asyncio", "pooch", "pty", "imp"),
}
NEVER_CALLED = {"eval", "exec", "compile", "__import__", "input", "breakpoint"}  # as names: re.compile is another
NEVER_CALLED_OF_A_MODULE = {
    "os": {"system", "popen", "startfile", "fork", "posix_spawn"},
    "subprocess": {"getoutput", "getstatusoutput"},
    "tempfile": {"mktemp"},
    "yaml": {"load"},
    "pandas": {"read_pickle"},
    "importlib": {"import_module"},
}
NEVER_GIVEN = {"allow_pickle": True, "shell": True}
# git describes the checkout; VTK crashes where it cannot render, and readers of meshes and surfaces on damaged files: these get
# processes of their own, which are this package.
MAY_START_PROGRAMS = {"results.files.provenance", "app.view.opengl", "app.view.rendering", "platform.host.child"}
MAY_FORK = {"platform.compiled.pieces"}  # it compiles kernels in child processes
# `explicitfe.run` is imported when it is first used; the names stand in a table.
MAY_IMPORT_BY_NAME = {"__init__"}


def breaches(module: str, tree: ast.AST) -> Iterator[str]:
    """Sentences on what a module does and must not do."""
    for name, line in imports(tree):
        top = name.split(".")[0]
        if top in NEVER_IMPORTED:
            yield f"{module}:{line} imports {name}"
        if top == "subprocess" and module not in MAY_START_PROGRAMS:
            yield f"{module}:{line} starts programs"
        if name == "importlib.import_module" and module not in MAY_IMPORT_BY_NAME:
            yield f"{module}:{line} imports by name"
        owner, _, last = name.rpartition(".")
        if last in NEVER_CALLED_OF_A_MODULE.get(owner, ()) and name != "importlib.import_module":
            yield f"{module}:{line} imports {name}"
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        if isinstance(node.func, ast.Name) and node.func.id in NEVER_CALLED:
            yield f"{module}:{node.lineno} calls {node.func.id}"
        if isinstance(node.func, ast.Attribute) and isinstance(node.func.value, ast.Name):
            owner, name = node.func.value.id, node.func.attr
            programs = owner == "os" and name.startswith(("exec", "spawn"))
            forks = name == "fork" and module in MAY_FORK
            if programs or (name in NEVER_CALLED_OF_A_MODULE.get(owner, ()) and not forks):
                yield f"{module}:{node.lineno} calls {owner}.{name}"
        if ast.unparse(node.func) in ("np.load", "numpy.load") and "allow_pickle=False" not in ast.unparse(node):
            yield f"{module}:{node.lineno} may load pickles"
        for keyword in node.keywords:
            value = keyword.value
            if keyword.arg in NEVER_GIVEN and not (isinstance(value, ast.Constant) and value.value is False):
                yield f"{module}:{node.lineno} gives {keyword.arg}"


def test_nothing_of_others_is_run() -> None:
    assert not [breach for module, tree in TREES.items() for breach in breaches(module, tree)]


def test_the_check_sees_what_it_should() -> None:
    seen = """
import pickle, os
from urllib.request import urlopen
from os import system
import subprocess
eval("1"); exec("1"); compile("1", "", "eval"); __import__("a")
os.system("a"); os.popen("a"); os.execv("a", []); os.spawnl(0, "a")
np.load("a"); subprocess.run("a", shell=True); f(allow_pickle=flag)
"""
    assert len(list(breaches("fem.mesh.box", ast.parse(seen)))) == 15
    fine = "import re, json, importlib.metadata\nre.compile('a'); simulation.compile(); f(shell=False); json.load(file)\n"
    fine += "np.load(file, allow_pickle=False)\n"
    assert not list(breaches("fem.mesh.box", ast.parse(fine)))


def test_every_text_of_a_page_is_escaped() -> None:
    """Templates never switch escaping off; what is marked as safe, and what may run, are files of our own."""
    pages = sorted((ROOT / "explicitfe").rglob("*.j2"))
    assert pages
    for page in pages:
        text = page.read_text(encoding="utf-8")
        # The frame puts scripts of the package into a page, which its policy names by digest; a page may hold data beside them.
        allowed = "<script>{{ script }}</script>" if page.name == "frame.html.j2" else '<script type="application/octet-stream">'
        text = text.replace(allowed, "")
        assert not re.search(r"\|\s*safe\b|autoescape\s+false|<script|\bon\w+=", text), page.name
    marked = [
        (module, ast.unparse(node))
        for module, tree in TREES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] == "Markup"
    ]
    assert marked == [
        ("app.view.page.frame", "Markup(files('explicitfe.app.view').joinpath(name).read_text(encoding='utf-8'))"),
    ]
    environments = [
        ast.unparse(node)
        for module, tree in TREES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in ("Environment", "Template")
    ]
    assert environments and all("autoescape=True" in environment for environment in environments)


def test_all_modules_are_read() -> None:
    assert {"app.cli.main", "app.view.page.close_loop.page", "platform.compiled.jit"} <= set(MODULES)
