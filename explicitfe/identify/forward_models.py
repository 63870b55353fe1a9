"""The forward models of a dataset's tests: one setup a curve, one response a geometry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from explicitfe.identify.assumptions import alternatives
from explicitfe.identify.fit import Observed
from explicitfe.identify.forward import FIRST_Q, CurveModel, PointResponse, Response, ToolResponse, UniformResponse
from explicitfe.measured.curve import Curve, programme_of, sd_of
from explicitfe.measured.select import Group
from explicitfe.predict.setup import Setup, is_uniform, setup_of

BEYOND = 1.15  # of the largest depth measured: how far a response goes under imposed forces


@dataclass
class ForwardModels:
    """Setups and responses, shared by all curves of one geometry."""

    groups: list[Group]
    poisson: float
    refinement: float

    def __post_init__(self) -> None:
        self.setups: dict[str, Setup] = {}
        self._responses: dict[str, Response] = {}
        largest: dict[str, float] = {}
        for group in self.groups:
            for curve in group.fitted + group.predicted:
                if curve.tool is None:
                    continue
                setup = self.setups[curve.id] = setup_of(curve, self.poisson, self.refinement)
                setup.tables(1.0, 0.0)
                # where forces are imposed, the model may sink in deeper than what was measured
                beyond = BEYOND if curve.tool.control == "force" else 1.0
                depth = beyond * float(curve.displacement_m[: group.rows[curve.id]].max())
                largest[setup.key] = max(largest.get(setup.key, 0.0), depth)
        self._largest = largest
        self.other_runs = 0

    @property
    def runs(self) -> int:
        """Simulations so far."""
        return self.other_runs + sum(response.runs for response in self._responses.values())

    def compile(self) -> None:
        """Have the machine code ready before anything is timed."""
        for setup in list(self.setups.values())[:1]:
            setup.relaxation(1.0, 0.0)

    def response(self, curve: Curve) -> Response:
        if curve.tool is None:
            kind: Literal["uniaxial", "shear"] = "shear" if curve.kind == "shear" else "uniaxial"
            return self._responses.setdefault(kind, PointResponse(kind, self.poisson))
        key = self.setups[curve.id].key
        if key not in self._responses:
            setup = self.setups[curve.id]
            self._responses[key] = UniformResponse(setup) if is_uniform(setup) else ToolResponse(setup, self._largest[key])
        return self._responses[key]

    def observed(self, curve: Curve, rows: int) -> Observed:
        by_force = curve.tool is not None and curve.tool.control == "force"
        return Observed(
            id=curve.id,
            imposed=programme_of(curve)[:rows],
            measured=curve.columns[curve.predicted][:rows],
            imposed_sd=sd_of(curve, curve.imposed),
            measured_sd=sd_of(curve, curve.predicted),
            model=CurveModel(self.response(curve), by_force),
        )

    def runs_planned(self, groups: Sequence[Group], method: str) -> int:
        """Runs that a usual identification takes."""
        count = 0
        for group in groups:
            tools = {self.setups[c.id].key for c in group.fitted if c.tool is not None}
            if tools:
                first = group.fitted[0]
                meshed = {self.setups[c.id].key for c in group.fitted if c.tool is not None and not is_uniform(self.setups[c.id])}
                count += 2 + len(alternatives(self.setups[first.id], first)) + 5 * len(meshed) + 8 * (method == "paper")
        everything = {s.key for s in self.setups.values() if not is_uniform(s)}
        return count + len(FIRST_Q) * len(everything)
