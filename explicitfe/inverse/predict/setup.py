"""The test behind a measured curve, as the tables of a scenario."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from typing import Literal

from typing_extensions import TypedDict

from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.solve.equilibrium import Relaxation
from explicitfe.fem.solve.load_outcome import Equilibrium
from explicitfe.inverse.measured.curve import Curve
from explicitfe.platform.errors import InputError, RunError
from explicitfe.simulate.anatomy.specimen import specimen_model

# A sharp edge has no usable solution: the stress is infinite there. It is rounded by the tool's radius over this.
RADIUS_OVER_SHARP_EDGE = 28.0
# A displacement of 90 % of the thickness is a mistake of height or unit [m/mm].
_LARGEST_DISPLACEMENT_M_MM = 9e-4


class SpecimenKeys(TypedDict, total=False):
    """Keys of a scenario's specimen, but for the material."""

    symmetry: Literal["sector", "quarter"]
    base: Literal["bonded", "sliding"]
    refinement: float
    radius_mm: float | None
    height_mm: float | None
    size_mm: list[float]
    layer_mm: float
    layer_stiffness_ratio: float
    gravity_m_s2: list[float]


class ToolKeys(TypedDict, total=False):
    """Keys of a scenario's tool."""

    shape: Literal["flat-cylinder", "sphere", "platen", "bonded-disc"]
    radius_mm: float
    edge_radius_mm: float
    friction: float | Literal["stick"]


# Constants of the laws of elements, in the order in which a fit has them.
CONSTANTS_OF_LAW = {"yeoh": ("C10_Pa", "C20_Pa", "C30_Pa"), "neo-hooke": ("C10_Pa",), "mooney-rivlin": ("C10_Pa", "C01_Pa")}


@dataclass(frozen=True)
class Setup:
    """A test, as the tables of a scenario.

    Attributes
    ----------
    specimen, tool : keys and values of the scenario's tables, without the material.
    poisson, density_kg_m3 : of the tissue.
    law : of the tissue, a key of ``CONSTANTS_OF_LAW``.
    assumed : what is supposed because the dataset does not state it, in words.
    """

    specimen: SpecimenKeys
    tool: ToolKeys
    poisson: float
    density_kg_m3: float
    assumed: tuple[str, ...] = field(default=(), compare=False)
    law: str = "yeoh"

    @property
    def key(self) -> str:
        """Two tests are equal where this text is; the density counts under gravity only."""
        heavy = any(self.specimen.get("gravity_m_s2", ()))
        density = self.density_kg_m3 if heavy else 0.0
        return json.dumps([self.specimen, self.tool, self.law, self.poisson, density], sort_keys=True)

    def tables(self, *constants: float) -> tuple[SpecimenTable, ToolTable]:
        """The tables of the scenario, validated; ``constants`` are those of the law, the last ones optional."""
        specimen = SpecimenTable.model_validate({**self.specimen, "material": self.material(*constants)})
        return specimen, ToolTable.model_validate(self.tool)

    def material(self, *constants: float) -> dict[str, str | float]:
        """The table of the tissue in a scenario."""
        named = dict(zip(CONSTANTS_OF_LAW[self.law], constants, strict=False))
        return {"law": self.law, **named, "poisson": self.poisson, "density_kg_m3": self.density_kg_m3}

    @property
    def height_mm(self) -> float:
        """Height of the specimen along the load [mm]."""
        if "size_mm" in self.specimen:
            return self.specimen["size_mm"][2]
        height_mm = self.specimen["height_mm"]
        assert height_mm is not None
        return height_mm

    @property
    def area_mm2(self) -> float:
        """Area of the specimen's loaded face [mm2]."""
        if "size_mm" in self.specimen:
            return self.specimen["size_mm"][0] * self.specimen["size_mm"][1]
        radius_mm = self.specimen["radius_mm"]
        assert radius_mm is not None
        return math.pi * radius_mm**2

    def relaxation(self, *constants: float, tolerance: float = 1e-4) -> Relaxation:
        """A body of this test, settled, its tool at first touch.

        Raises
        ------
        RunError : it does not come to rest.
        """
        # One thread computes it: fitted constants must not depend on the number of cores.
        body = Relaxation(specimen_model(*self.tables(*constants)), tolerance, threads=1)
        body.compile()
        # Without gravity the body is at rest as it is, and the tool touches at 0.
        if any(self.specimen.get("gravity_m_s2", ())) and not isinstance(body.settle(), Equilibrium):
            raise RunError("the specimen does not come to rest under its own weight; it is too soft or too tall.")
        return body


def setup_of(curve: Curve, poisson: float, refinement: float) -> Setup:
    """The test of a curve with a tool; what the dataset leaves open is supposed, and said in ``assumed``.

    Raises
    ------
    InputError : the simulator has no such test.
    """
    specimen, tool = curve.specimen, curve.tool
    assert specimen is not None and tool is not None
    given = (("specimen", specimen.assumed), ("tool", tool.assumed))
    assumed = [f"the {whose}'s {_words(key)}" for whose, keys in given for key in keys if key != "density_kg_m3"]
    platen = tool.shape == "platen"
    slides = specimen.base == "frictionless" or (specimen.base == "unknown" and platen)
    if specimen.base == "unknown":
        assumed.append("both faces slide" if platen else "the base is bonded")
    friction: float | Literal["stick"] = 0.0
    if tool.friction == "stick" or (tool.friction != "unknown" and float(tool.friction) > 1.0):
        friction = "stick"
    elif tool.friction != "unknown":
        friction = float(tool.friction)
    elif tool.shape != "bonded-disc" and not (platen and specimen.base == "unknown"):
        assumed.append("no friction under the tool")

    body: SpecimenKeys = {"base": "sliding" if slides else "bonded", "refinement": refinement}
    if specimen.size_mm is None:
        body = {**body, "symmetry": "sector", "radius_mm": specimen.radius_mm, "height_mm": specimen.height_mm}
    else:
        body = {**body, "symmetry": "quarter", "size_mm": list(specimen.size_mm)}
    if specimen.layer_mm > 0.0:
        body = {**body, "layer_mm": specimen.layer_mm, "layer_stiffness_ratio": specimen.layer_stiffness_ratio}
    tool_keys: ToolKeys = {"shape": tool.shape}
    if tool.radius_mm is not None:
        tool_keys["radius_mm"] = tool.radius_mm
    if tool.shape != "bonded-disc":
        tool_keys["friction"] = friction
    if tool.shape == "flat-cylinder":
        assert tool.radius_mm is not None
        tool_keys["edge_radius_mm"] = tool.edge_radius_mm or tool.radius_mm / RADIUS_OVER_SHARP_EDGE
        if tool.edge_radius_mm == 0.0:
            assumed.append(f"the tool's sharp edge is rounded by {tool_keys['edge_radius_mm']:.3g} mm")
    if curve.displacement_m.max() <= 0.0:
        raise InputError(
            f'curve "{curve.id}": the tool pulls only; tests under a tool are identified from pressing, displacement above 0.'
        )
    if curve.displacement_m.max() > _LARGEST_DISPLACEMENT_M_MM * specimen.thickness_mm:
        raise InputError(
            f'curve "{curve.id}": the displacement reaches {1e3 * curve.displacement_m.max():.3g} mm of a specimen that is '
            f"{specimen.thickness_mm:g} mm thick; check height and unit."
        )
    return Setup(body, tool_keys, poisson, specimen.density_kg_m3, tuple(assumed))


def _words(key: str) -> str:
    for ending in ("_mm", "_kg_m3"):
        key = key.removesuffix(ending)
    return key.replace("_", " ")


def is_uniform(setup: Setup) -> bool:
    """Whether nothing keeps the specimen from a homogeneous state."""
    plain = setup.specimen.get("layer_mm", 0.0) == 0.0 and not any(setup.specimen.get("gravity_m_s2", ()))
    return setup.tool["shape"] == "platen" and setup.tool["friction"] == 0.0 and setup.specimen["base"] == "sliding" and plain
