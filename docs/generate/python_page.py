"""The page of the Python names: signature and docstring of every attribute of ``explicitfe``."""

from __future__ import annotations

import inspect
import re

HEAD = """# Python: every name of `explicitfe`

Made from the docstrings. Positions are in m, forces in N, times in s; a name says its unit where it is another one. How the parts
work together: [Models in Python](../tutorials/python.md).

"""
GROUPS = {
    "Commands": ("run", "resume", "check", "check_dataset", "identify", "predict", "close_loop", "design_test", "open_result"),
    "Meshes and models": (
        "HexMesh", "box", "Yeoh", "NeoHooke", "MooneyRivlin", "Model", "Inclusion", "tongue_model", "specimen_model",
        "SpecimenTable", "ToolTable",
    ),
    "Loads": ("NodalLoad", "face_load", "gravity_load", "Profile"),
    "Solvers": ("Simulation", "Transient", "Relaxation"),
    "Errors": ("InputError", "RunError"),
}  # fmt: skip
_SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}$", re.M)
_ENTRY = re.compile(r"^(\*{0,2}\w[\w, *.]*?) : ", re.M)


def python_page() -> str:
    """Markdown of all names, in groups; a name of the package that has no group stands under "More"."""
    import explicitfe

    grouped = {name for names in GROUPS.values() for name in names}
    more = [name for name in explicitfe.__all__ if name not in grouped and not name.startswith("__")]
    groups = {heading: [name for name in names if name in explicitfe.__all__] for heading, names in GROUPS.items()}
    sections = [HEAD]
    for heading, names in (groups | ({"More": more} if more else {})).items():
        sections.append(f"## {heading}\n")
        sections += [_entry(name, getattr(explicitfe, name), 3) for name in names]
    return "\n".join(sections)


def _entry(name: str, value: object, level: int) -> str:
    lines = [f"{'#' * level} {name}", "", f"```text\n{name}{_signature(value)}\n```", "", _markdown(inspect.getdoc(value) or "")]
    if inspect.isclass(value) and not issubclass(value, Exception):
        lines += [
            _entry(f"{name}.{key}", member, level + 1)
            for key, member in vars(value).items()
            if inspect.isfunction(member) and not key.startswith("_") and inspect.getdoc(member)
        ]
    return "\n".join([*lines, ""])


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
