"""The house: a module is short and has its place, a name has one meaning, an effect answers for itself.

Read from the source with ``ast``; nothing is imported.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator

import pytest
from support import ROOT

PACKAGE = ROOT / "explicitfe"
# What may stand at the top of the package, beside the wings: `import explicitfe`, `python -m explicitfe`, and the mark that the
# package ships its types.
LOOSE = {"__init__.py", "__init__.pyi", "__main__.py", "py.typed"}
LONGEST_MODULE_LINES = 450
MOST_UNTYPED_DICTIONARIES = 78
MOST_ARGUMENTS = 12
LONGEST_CLASS_LINES = 250
# They were longer when the limit was set.
LONG_CLASSES = {
    *("Simulation", "Relaxation", "Revolution", "Transient", "SectionNewton"),
    *("Result", "ResultWriter", "TransientAnalysis", "Comparing", "Specimens", "Trajectories"),
}
MOST_PARTICIPLES = 210
NOT_PARTICIPLES = {"need", "feed", "speed", "seed", "embed", "read"}
# Texts and tables: the same noun in rooms that do not know each other, and the interface of elements.
NAMES_OF_SEVERAL_ROOMS = {
    *("NAMES", "SIDES", "FORMAT", "COARSE", "KINDS", "TIME", "VARIABLE", "_PACKAGE", "_KINDS", "PACKAGES", "_VEC"),
    *("HAS_BARRIER", "LEAVES", "PARTS", "PAGE_FILE", "PICTURES", "FORMATS"),
}
# Here numbers decide a verdict or a method: their names have to say what they are.
ROOMS_WITH_NAMED_NUMBERS = ["inverse", "results", "app", "simulate"]
AXES = ("X", "Y", "Z")
EFFECT_FOLDERS = ["material", "specimen", "tool", "reading", "muscle"]
# They say nothing about what they hold.
EMPTY_NAMES = {"found", "way", "there", "mine", "told", "made", "rest"}

FILES = {path.relative_to(ROOT).as_posix(): path for path in sorted(PACKAGE.rglob("*.py"))}
TREES = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in FILES.items()}
ROOMS = sorted(path.relative_to(PACKAGE).as_posix() for path in PACKAGE.glob("*/*") if path.is_dir() and any(path.rglob("*.py")))


def in_room(room: str) -> dict[str, ast.Module]:
    """The modules of a room of the package."""
    return {name: tree for name, tree in TREES.items() if name.startswith(f"explicitfe/{room}/")}


def is_number(node: ast.AST | None) -> bool:
    """Whether an expression is a number, or arithmetic with numbers, or a tuple or a list of them."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, (int, float)) and not isinstance(node.value, bool)
    if isinstance(node, ast.UnaryOp):
        return is_number(node.operand)
    if isinstance(node, ast.BinOp):
        return is_number(node.left) and is_number(node.right)
    return isinstance(node, (ast.Tuple, ast.List)) and bool(node.elts) and all(is_number(item) for item in node.elts)


def constants(tree: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    """Names in capitals that a module gives a value, with the value."""
    for node in tree.body:
        pairs: list[tuple[ast.expr, ast.expr]] = []
        if isinstance(node, ast.Assign):
            for target in node.targets:
                several = isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple)
                pairs += zip(target.elts, node.value.elts, strict=True) if several else [(target, node.value)]
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            pairs = [(node.target, node.value)]
        yield from ((target.id, value) for target, value in pairs if isinstance(target, ast.Name) and target.id.isupper())


def identifiers(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Every name that a tree gives or uses, with its line: variables, functions, classes, parameters, attributes, imports."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            yield node.id, node.lineno
        elif isinstance(node, ast.Attribute):
            yield node.attr, node.lineno
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            yield node.name, node.lineno
        elif isinstance(node, ast.arg):
            yield node.arg, node.lineno
        elif isinstance(node, ast.keyword) and node.arg:
            yield node.arg, node.value.lineno
        elif isinstance(node, ast.alias):
            yield node.asname or node.name.split(".")[-1], node.lineno


def asked_classes(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Names of the classes that a tree asks an object for, by isinstance, issubclass, ``type(x) is`` or ``case Class()``."""
    for node in ast.walk(tree):
        asked: list[ast.AST] = []
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("isinstance", "issubclass"):
            asked = node.args[1:]
        elif isinstance(node, ast.Compare) and "type(" in ast.unparse(node):
            asked = [node.left, *node.comparators]
        elif isinstance(node, ast.MatchClass):
            asked = [node.cls]
        for expression in asked:
            for part in ast.walk(expression):
                if isinstance(part, ast.Name):
                    yield part.id, part.lineno
                elif isinstance(part, ast.Attribute):
                    yield part.attr, part.lineno


def test_nothing_is_loose_at_the_top():
    assert {path.name for path in PACKAGE.iterdir() if path.is_file()} <= LOOSE


def test_the_top_is_complete():
    assert {path.name for path in PACKAGE.iterdir() if path.is_file()} >= LOOSE


@pytest.mark.parametrize("room", [*ROOMS, "."])
def test_modules_are_short(room):
    files = FILES if room == "." else in_room(room)
    lengths = {name: len(FILES[name].read_text(encoding="utf-8").splitlines()) for name in files}
    long = [f"{name}: {lines} lines" for name, lines in lengths.items() if lines > LONGEST_MODULE_LINES]
    assert not long, "\n".join(long)


def test_a_class_name_means_one_class():
    places = defaultdict(list)
    for name, tree in TREES.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(name)
    twice = [f"{name}: {', '.join(files)}" for name, files in places.items() if len(files) > 1]
    assert not twice, "\n".join(twice)


@pytest.mark.parametrize("room", ROOMS_WITH_NAMED_NUMBERS)
def test_a_number_has_a_name_of_several_words(room):
    """A noun with its unit, or the share of what it is: ``ITERATIONS_WITHOUT_PROGRESS``, not ``PATIENCE``."""
    short = [
        f"{module}: {name} = {ast.unparse(value)}"
        for module, tree in in_room(room).items()
        for name, value in constants(tree)
        if is_number(value) and "_" not in name.strip("_") and name not in AXES
    ]
    assert not short, "\n".join(short)


def test_a_constant_has_one_value():
    """A number has; of texts and tables some names stand for the same thing in several rooms, and no more."""
    values = defaultdict(lambda: defaultdict(list))
    for module, tree in TREES.items():
        for name, value in constants(tree):
            values[name][ast.unparse(value)].append(module)
    several = {name for name, of in values.items() if len(of) > 1}
    numbers = {name for name in several if any(is_number(ast.parse(value, mode="eval").body) for value in values[name])}
    assert not numbers, {name: dict(values[name]) for name in numbers}
    assert several == NAMES_OF_SEVERAL_ROOMS


def test_classes_are_short():
    """The exceptions are all that there are; the number is that of their lines, which may only fall."""
    lengths = {
        f"{name} {node.name}": node.end_lineno - node.lineno + 1
        for name, tree in TREES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    }
    long = {name.rpartition(" ")[2] for name, lines in lengths.items() if lines > LONGEST_CLASS_LINES}
    assert long == LONG_CLASSES


def test_functions_are_verbs_or_nouns():
    """Few are named by a participle; a new one is a verb with an object, or the noun of its value."""
    participles = [
        f"{name} {node.name}"
        for name, tree in TREES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        and node.name.strip("_").split("_")[0].endswith("ed")
        and node.name.strip("_").split("_")[0] not in NOT_PARTICIPLES
        and not any("property" in ast.unparse(decorator) for decorator in node.decorator_list)
    ]
    assert len(participles) <= MOST_PARTICIPLES, participles


@pytest.mark.parametrize("room", [room for room in ROOMS if room != "fem/effects"])
def test_nobody_asks_which_effect_it_is(room):
    """An effect answers questions about itself (``effects/effect.py``); a room above asks these, not for the class."""
    named = {
        node.name
        for folder in EFFECT_FOLDERS
        for tree in in_room(f"fem/effects/{folder}").values()
        for node in tree.body
        if isinstance(node, ast.ClassDef)
    }
    assert named
    asked = [
        f"{name}:{line} {asks}" for name, tree in in_room(room).items() for asks, line in asked_classes(tree) if asks in named
    ]
    assert not asked, "\n".join(asked)


@pytest.mark.parametrize("room", [*ROOMS, "."])
def test_a_name_says_what_it_holds(room):
    trees = in_room(room) if room != "." else {name: tree for name, tree in TREES.items() if name.count("/") <= 2}
    empty = [f"{name}:{line} {word}" for name, tree in trees.items() for word, line in identifiers(tree) if word in EMPTY_NAMES]
    empty = sorted(empty, key=lambda text: (text.partition(":")[0], int(text.partition(":")[2].split()[0])))
    assert not empty, "\n".join(empty)


def test_few_dictionaries_of_anything():
    """What a dictionary holds is said by a type: a dataclass, a TypedDict or a pydantic model."""
    lines = [
        f"{name}:{number}"
        for name, path in FILES.items()
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if re.search(r"\b(dict|Mapping)\[str, Any\]|\bRawTable\b", line)
    ]
    assert len(lines) < MOST_UNTYPED_DICTIONARIES, "\n".join(lines)


def long_signatures(tree: ast.AST) -> Iterator[str]:
    """Functions with more than ``MOST_ARGUMENTS`` arguments."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            arguments = node.args
            if len(arguments.posonlyargs) + len(arguments.args) + len(arguments.kwonlyargs) > MOST_ARGUMENTS:
                yield node.name


def test_signatures_are_short():
    """What belongs together is one argument."""
    assert [f"{name} {function}" for name, tree in TREES.items() for function in long_signatures(tree)] == []


def test_the_checks_see_what_they_should():
    """Each check finds what it forbids."""
    many = ", ".join(f"a{k}" for k in range(MOST_ARGUMENTS + 1))
    assert list(long_signatures(ast.parse(f"def long({many}): ...\ndef short(a, *, b): ...\n"))) == ["long"]
    tree = ast.parse("FAR = -0.5 * 2\nSIZES = (1, 2.0)\nNAMES = ('a',)\nON = True\nNEAR, FIRST = 1, 2\n")
    assert [name for name, value in constants(tree) if is_number(value)] == ["FAR", "SIZES", "NEAR", "FIRST"]
    tree = ast.parse("def f(way):\n    there = way.rest\n    g(told=1)\n")
    assert {name for name, _ in identifiers(tree)} & EMPTY_NAMES == {"way", "there", "rest", "told"}
    tree = ast.parse("isinstance(e, (Fibres, a.Layer))\ntype(e) is Fibres\nmatch e:\n    case Fibres():\n        pass\n")
    classes = [name for name, _ in asked_classes(tree) if name in ("Fibres", "Layer")]
    assert sorted(classes) == ["Fibres", "Fibres", "Fibres", "Layer"]
