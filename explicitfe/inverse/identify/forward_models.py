"""Forward models of the tests of a dataset: one setup per curve, one response per geometry and law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from explicitfe.fem.materials.homogeneous import INCOMPRESSIBLE, Mode
from explicitfe.inverse.identify.assumptions import alternatives
from explicitfe.inverse.identify.forward import FIRST_Q, CurveModel, PointResponse, Response, ToolResponse, UniformResponse
from explicitfe.inverse.identify.laws import FIT_LAWS, YEOH, FitLaw
from explicitfe.inverse.identify.observed import Observed
from explicitfe.inverse.measured.contact import contact_start
from explicitfe.inverse.measured.curve import Curve, programme_of, sd_of
from explicitfe.inverse.measured.select import Group
from explicitfe.inverse.predict.setup import Setup, is_uniform, setup_of

POISSON_OF_ELEMENTS = 0.499
MODE_OF_CURVE: dict[str, Mode] = {"uniaxial": "uniaxial", "equibiaxial": "biaxial", "planar": "planar", "shear": "shear"}
# Where forces are imposed, the model may sink in deeper than what was measured: a response goes so much farther.
LARGEST_DEPTH_FACTOR = 1.15
# So many runs of the simulator are planned for a group with a tool, for each of its meshed tests, and for the paper's method.
PLANNED_RUNS_OF_A_GROUP = 2
PLANNED_RUNS_OF_A_TEST = 5
PLANNED_RUNS_BY_PAPER = 8


@dataclass
class ForwardModels:
    """Setups and responses of the curves; curves of one geometry share them.

    Attributes
    ----------
    poisson : Poisson's ratio; None: closed forms are incompressible, and elements have 0.499.
    setups : curve with a tool -> its test.
    other_runs : simulator runs that do not belong to a response.
    """

    groups: list[Group]
    poisson: float | None
    refinement: float

    def __post_init__(self) -> None:
        self.of_elements = POISSON_OF_ELEMENTS if self.poisson is None else self.poisson
        self.of_closed_forms = INCOMPRESSIBLE if self.poisson is None else self.poisson
        self.setups: dict[str, Setup] = {}
        self._responses: dict[tuple[str, str], Response] = {}
        largest: dict[str, float] = {}
        for group in self.groups:
            for curve in group.fitted + group.predicted:
                if curve.tool is None:
                    continue
                setup = self.setups[curve.id] = setup_of(curve, self.of_elements, self.refinement)
                setup.tables(1.0, 0.0)
                factor = LARGEST_DEPTH_FACTOR if curve.tool.control == "force" or curve.fit_contact else 1.0
                depth = factor * float((curve.displacement_m - (contact_start(curve) or 0.0))[: group.rows[curve.id]].max())
                largest[setup.key] = max(largest.get(setup.key, 0.0), depth)
        self._largest = largest
        self.other_runs = 0

    @property
    def runs(self) -> int:
        """Runs of the simulator so far."""
        return self.other_runs + sum(response.runs for response in self._responses.values())

    @property
    def homogeneous(self) -> bool:
        """Whether no test needs the simulator for its fit."""
        return all(is_uniform(setup) for setup in self.setups.values())

    @property
    def reported_poisson(self) -> float:
        """Poisson's ratio of the answer: that of elements if any test needs them."""
        return self.of_closed_forms if self.homogeneous else self.of_elements

    def compile(self, laws: Sequence[FitLaw] = (YEOH,)) -> None:
        """Compile the kernels before the fit begins."""
        for setup in list(self.setups.values())[:1]:
            for key in dict.fromkeys(law.key for law in laws if law.in_elements):
                replace(setup, law=key).relaxation(1.0, 0.0)

    def assumed(self, group: Group) -> list[str]:
        """Assumptions on the tests of a group, in words."""
        texts = {text for curve in group.fitted if curve.tool is not None for text in self.setups[curve.id].assumed}
        closed = [curve.tool is None or is_uniform(self.setups[curve.id]) for curve in group.fitted]
        poisson = {f"Poisson's ratio {self.of_closed_forms if form else self.of_elements:g}" for form in closed}
        incompressible = f"Poisson's ratio {INCOMPRESSIBLE:g}"
        named = [text + (" (incompressible closed form)" if text == incompressible else "") for text in sorted(poisson)]
        return [*sorted(texts), *named]

    def response(self, curve: Curve, law: FitLaw = YEOH) -> Response:
        """Response of a law in the test of a curve."""
        if curve.tool is None:
            kind = MODE_OF_CURVE[curve.kind]
            return self._responses.setdefault((kind, law.name), PointResponse(kind, self.of_closed_forms, law))
        setup = self.setups[curve.id]
        uniform = is_uniform(setup)
        # Under a tool the neo-Hooke law is the Yeoh law with C20 = 0 and uses its runs.
        name = law.name if uniform or law.name == "mooney-rivlin" else YEOH.name
        key = setup.key, name
        if key not in self._responses:
            own = replace(setup, law=FIT_LAWS[name].key)
            self._responses[key] = (
                UniformResponse(setup, self.of_closed_forms, law) if uniform else ToolResponse(own, self._largest[setup.key])
            )
        return self._responses[key]

    def observed(self, curve: Curve, rows: int, law: FitLaw = YEOH) -> Observed:
        """The first rows of a curve, with the model of a law that predicts them."""
        by_force = curve.tool is not None and curve.tool.control == "force"
        return Observed(
            id=curve.id,
            imposed=programme_of(curve)[:rows],
            measured=curve.columns[curve.predicted][:rows],
            imposed_sd=sd_of(curve, curve.imposed),
            measured_sd=sd_of(curve, curve.predicted),
            model=CurveModel(self.response(curve, law), by_force),
            contact_m=contact_start(curve),
        )

    def runs_planned(self, groups: Sequence[Group], method: str, laws: Sequence[FitLaw] = (YEOH,)) -> int:
        """Simulator runs of a usual identification."""
        count = 0
        for group in groups:
            if self.homogeneous:
                count += 1 + len(laws)
            tools = {self.setups[c.id].key for c in group.fitted if c.tool is not None}
            if tools:
                first = next(c for c in group.fitted if c.tool is not None)
                meshed = {self.setups[c.id].key for c in group.fitted if c.tool is not None and not is_uniform(self.setups[c.id])}
                count += PLANNED_RUNS_OF_A_GROUP + len(alternatives(self.setups[first.id], first))
                count += PLANNED_RUNS_OF_A_TEST * len(meshed) * len(laws)
                count += PLANNED_RUNS_BY_PAPER if method == "paper" else 0
        all_meshed = {setup.key for setup in self.setups.values() if not is_uniform(setup)}
        return count + len(FIRST_Q) * len(all_meshed)
