"""The test behind a measured curve, as the tables of a scenario."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any, Literal

from explicitfe.errors import InputError, RunError
from explicitfe.measured.curve import Curve
from explicitfe.model.specimen import specimen_model
from explicitfe.scenario.indentation import SpecimenTable, ToolTable
from explicitfe.solve.equilibrium import Equilibrium, Relaxation

SHARP = 28.0  # a sharp edge has no usable solution: it is rounded by the tool's radius over this


@dataclass(frozen=True)
class Setup:
    """A test, as the tables of a scenario.

    Attributes
    ----------
    specimen, tool : keys and values of the scenario's tables, without the material.
    poisson, density_kg_m3 : of the tissue.
    assumed : what is supposed and not stated by the dataset, in words.
    """

    specimen: dict[str, Any]
    tool: dict[str, Any]
    poisson: float
    density_kg_m3: float
    assumed: tuple[str, ...] = field(default=(), compare=False)

    @property
    def key(self) -> str:
        """Equal for equal tests; density counts under gravity only."""
        heavy = any(self.specimen.get("gravity_m_s2", ()))
        return json.dumps([self.specimen, self.tool, self.poisson, self.density_kg_m3 if heavy else 0.0], sort_keys=True)

    def tables(self, C10_Pa: float, C20_Pa: float) -> tuple[SpecimenTable, ToolTable]:
        """The scenario's own tables, checked."""
        return SpecimenTable(**self.specimen, material=self.material(C10_Pa, C20_Pa)), ToolTable(**self.tool)

    def material(self, C10_Pa: float, C20_Pa: float) -> dict[str, Any]:
        """The tissue as a scenario states it."""
        return {
            "law": "yeoh",
            "C10_Pa": C10_Pa,
            "C20_Pa": C20_Pa,
            "poisson": self.poisson,
            "density_kg_m3": self.density_kg_m3,
        }

    def relaxation(self, C10_Pa: float, C20_Pa: float, tolerance: float = 1e-4) -> Relaxation:
        """A body of this test, settled, its tool at first touch.

        Raises
        ------
        RunError : it does not come to rest.
        """
        # One thread: the constants that are found do not depend on the machine's cores.
        body = Relaxation(specimen_model(*self.tables(C10_Pa, C20_Pa)), tolerance, threads=1)
        body.compile()
        # Without gravity the body is at rest as it is, and the tool touches at 0.
        if any(self.specimen.get("gravity_m_s2", ())) and not isinstance(body.settle(), Equilibrium):
            raise RunError("the specimen does not come to rest under its own weight; it is too soft or too tall.")
        return body


def setup_of(curve: Curve, poisson: float, refinement: float) -> Setup:
    """The test of a curve with a tool, with what the dataset leaves open supposed.

    Raises
    ------
    InputError : the test is none that the simulator knows.
    """
    specimen, tool = curve.specimen, curve.tool
    assert specimen is not None and tool is not None
    given = (("specimen", specimen.assumed), ("tool", tool.assumed))
    assumed = [f"the {whose}'s {_words(key)}" for whose, keys in given for key in keys if key != "density_kg_m3"]
    platen = tool.shape == "platen"
    base = {"bonded": "bonded", "frictionless": "sliding", "unknown": "sliding" if platen else "bonded"}[specimen.base]
    if specimen.base == "unknown":
        assumed.append("both faces slide" if platen else "the base is bonded")
    friction: float | Literal["stick"] = 0.0
    if tool.friction == "stick" or (tool.friction != "unknown" and float(tool.friction) > 1.0):
        friction = "stick"
    elif tool.friction != "unknown":
        friction = float(tool.friction)
    elif tool.shape != "bonded-disc" and not (platen and specimen.base == "unknown"):
        assumed.append("no friction under the tool")

    body: dict[str, Any] = {"base": base, "refinement": refinement}
    if specimen.size_mm is None:
        body |= {"symmetry": "sector", "radius_mm": specimen.radius_mm, "height_mm": specimen.height_mm}
    else:
        body |= {"symmetry": "quarter", "size_mm": list(specimen.size_mm)}
    if specimen.layer_mm > 0.0:
        body |= {"layer_mm": specimen.layer_mm, "layer_stiffness_ratio": specimen.layer_stiffness_ratio}
    hand: dict[str, Any] = {"shape": tool.shape}
    if tool.radius_mm is not None:
        hand["radius_mm"] = tool.radius_mm
    if tool.shape != "bonded-disc":
        hand["friction"] = friction
    if tool.shape == "flat-cylinder":
        assert tool.radius_mm is not None
        hand["edge_radius_mm"] = tool.edge_radius_mm or tool.radius_mm / SHARP
        if tool.edge_radius_mm == 0.0:
            assumed.append(f"the tool's sharp edge is rounded by {hand['edge_radius_mm']:.3g} mm")
    if curve.displacement_m.max() <= 0.0:
        raise InputError(
            f'curve "{curve.id}": the tool pulls only; tests under a tool are identified from pressing, displacement above 0.'
        )
    if curve.displacement_m.max() > 9e-4 * specimen.thickness_mm:
        raise InputError(
            f'curve "{curve.id}": the displacement reaches {1e3 * curve.displacement_m.max():.3g} mm of a specimen that is '
            f"{specimen.thickness_mm:g} mm thick; check height and unit."
        )
    return Setup(body, hand, poisson, specimen.density_kg_m3, tuple(assumed))


def _words(key: str) -> str:
    for ending in ("_mm", "_kg_m3"):
        key = key.removesuffix(ending)
    return key.replace("_", " ")


def is_uniform(setup: Setup) -> bool:
    """Whether nothing keeps the specimen from a homogeneous state."""
    plain = setup.specimen.get("layer_mm", 0.0) == 0.0 and not any(setup.specimen.get("gravity_m_s2", ()))
    return setup.tool["shape"] == "platen" and setup.tool["friction"] == 0.0 and setup.specimen["base"] == "sliding" and plain
