"""The page of the Python names: signature and docstring of every attribute of ``explicitfe``."""

from __future__ import annotations

import inspect
import re
from functools import cached_property

from pydantic import BaseModel
from pydantic.fields import FieldInfo

HEAD = """# Python reference

All public names of `explicitfe`. Positions are in m, forces in N, times in s; other units are part of the name. For examples see
the [Python tutorial](../tutorials/python.md). Every function raises an `InputError` that names the parameter if an argument is
invalid.

"""
GROUPS = {
    "Runs and data": (
        "run", "resume", "save", "sweep", "SweepDesign", "SweepExecution", "check", "check_dataset", "identify", "predict",
        "close_loop", "design_test", "propose_tests",
    ),
    "Results": ("open_result", "Result", "measure", "compare", "compare_recording", "plot", "view", "report", "export"),
    "Meshes and models": (
        "HexMesh", "box", "Yeoh", "NeoHooke", "MooneyRivlin", "Ogden", "Model", "Inclusion", "Bone",
        "tongue_model", "specimen_model", "SpecimenTable", "ToolTable",
    ),
    "Effects of the material": (
        "Viscoelastic", "NonlinearRelaxation", "PowerLaw", "Fractional", "Softening", "PermanentSet",
        "Payne", "ThirdYeoh", "Fibres", "Compressible", "Drainage", "DiscoveredLaw",
    ),
    "Extensions": ("register_law", "register_effect"),
    "Loads": ("NodalLoad", "face_load", "gravity_load", "Profile"),
    "Solvers": ("Simulation", "Transient", "Relaxation"),
    "Errors": ("InputError", "RunError"),
}  # fmt: skip
_VALUES = (property, cached_property)
_SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.M)
_ENTRY = re.compile(r"^(\*{0,2}\w[\w, *.]*?) : ", re.M)


def python_page() -> str:
    """Markdown of all names, in groups; names of the package without a group are listed under "More"."""
    import explicitfe
    from explicitfe.results.files import Result

    grouped = {name for names in GROUPS.values() for name in names}
    more = [name for name in explicitfe.__all__ if name not in grouped and not name.startswith("__")]
    other = {"Result": Result}  # what open_result returns
    groups = {heading: [name for name in names if name in {*explicitfe.__all__, *other}] for heading, names in GROUPS.items()}
    sections = [HEAD]
    for heading, names in (groups | ({"More": more} if more else {})).items():
        sections.append(f"## {heading}\n")
        sections += [_entry(name, other.get(name) or getattr(explicitfe, name), 3) for name in names]
    return "\n".join(sections)


def _entry(name: str, value: object, level: int) -> str:
    lines = [f"{'#' * level} {name}", "", f"```text\n{name}{_signature(value)}\n```", "", _markdown(inspect.getdoc(value) or "")]
    if inspect.isclass(value) and issubclass(value, BaseModel):
        lines += ["", "**Parameters**", "", *(_key(key, field) for key, field in value.model_fields.items())]
    if inspect.isclass(value) and not issubclass(value, Exception):
        members = {key: member for kind in reversed(value.__mro__) if kind.__module__.startswith("explicitfe") for key, member in
                   vars(kind).items() if not key.startswith("_") and inspect.getdoc(member)}  # fmt: skip
        values = [f"- `{key}`: {_first_line(member)}" for key, member in members.items() if isinstance(member, _VALUES)]
        lines += ["", "**Properties**", "", *values, ""] if values else [""]
        lines += [
            _entry(f"{name}.{key}", getattr(value, key), level + 1)
            for key, member in members.items()
            if inspect.isfunction(member) or isinstance(member, classmethod)
        ]
    return "\n".join([*lines, ""])


def _key(name: str, field: FieldInfo) -> str:
    """A key of a table or a constant of a law as an entry of a list."""
    default = "required" if field.is_required() else f"default: `{field.get_default(call_default_factory=True)!r}`"
    return f"- `{name}`: {field.description or ''} ({default})"


def _first_line(member: object) -> str:
    return (inspect.getdoc(member) or "").split("\n\n")[0].replace("\n", " ").replace("``", "`").replace("<", "&lt;")


def _signature(value: object) -> str:
    try:
        signature = inspect.signature(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return ""
    shown = [parameter.replace(annotation=inspect.Parameter.empty) for parameter in signature.parameters.values()]
    plain = str(signature.replace(parameters=shown, return_annotation=inspect.Signature.empty))
    plain = re.sub(r"<function (\w+) at 0x\w+>", r"\1", plain)
    return plain if len(plain) < 100 else "(\n    " + plain[1:-1].replace(", ", ",\n    ") + "\n)"


def _markdown(text: str) -> str:
    """A docstring with sections such as "Parameters" as Markdown with lists."""
    text = text.replace("``", "`").replace("<", "&lt;")
    words, *sections = _SECTION.split(text)
    parts = [words.strip()]
    for heading, body in zip(sections[::2], sections[1::2], strict=True):
        joined = re.sub(r"\n[ ]{4,}", " ", body.strip())
        parts.append(f"**{heading}**\n\n" + _ENTRY.sub(lambda match: f"- `{match[1]}`: ", joined))
    return "\n\n".join(parts)
