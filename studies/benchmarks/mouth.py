"""Settled postures of the built-in tongue, a quarter of a second each: for studies/benchmarks/posture_search.py.

    mouth = Mouth("coarse")
    settled = mouth.settle(Posture({"GGp": 2.0}, opening_mm=3.0))

Living tissue, muscles as stress, ties by area, palate, jaw, pharynx, the hyoid bone on its springs. What postures share is built
once: the mesh, the distances of the bones, and the stress of each muscle for 1 N.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from explicitfe.fem.bones.surface import TriangleSurface
from explicitfe.fem.mesh.triangles import surface_triangles
from explicitfe.fem.mesh.validity import certify
from explicitfe.fem.model.fibre_stress import fibre_stress, outside_pull
from explicitfe.fem.model.model import Model
from explicitfe.fem.model.profile import Profile
from explicitfe.fem.solve.ledger import Ledger
from explicitfe.fem.solve.simulation import Simulation
from explicitfe.fem.solve.transient import Transient
from explicitfe.platform.errors import RunError
from explicitfe.results.measure.airway import bounds_of_air
from explicitfe.results.measure.formants import Piece, formants_of, joined, pieces_between
from explicitfe.results.measure.sections import PlaneCut, X, Z, midsagittal
from explicitfe.results.measure.tract import palate_midline
from explicitfe.simulate.anatomy import catalogue
from explicitfe.simulate.anatomy.bones import bones_of, jaw_motion
from explicitfe.simulate.anatomy.tongue import assemble
from explicitfe.simulate.scenario.bones import BoneTable, HyoidTable, JawTable
from explicitfe.simulate.scenario.transient import AnalysisTable, Damping, ModelTable, TransientScenario

ALWAYS = Profile.constant()
SAMPLE_EVERY_S = 0.02  # for the energy balance
# Regions along the midline of the palate, mm behind the edge of the upper incisors: behind the teeth, the hard palate, and the
# soft palate, whose front end is put where the palate begins to fall (x = 103 mm): a choice.
REGIONS_MM = {"teeth": (0.0, 22.0), "hard palate": (22.0, 60.0), "soft palate": (60.0, 88.0)}


@dataclass(frozen=True)
class Posture:
    """Forces of muscles, N, both sides together, and how far the jaw opens, mm; both rise within ``rise_ms``, then hold."""

    forces_N: Mapping[str, float] = field(default_factory=dict)
    opening_mm: float = 0.0
    rise_ms: float = 50.0
    duration_ms: float = 200.0


@dataclass(frozen=True)
class Settled:
    """What a posture came to.

    Attributes
    ----------
    status : "finished", or why the run could not go on.
    displacement : (n, 3) m at the end.
    hourglass_share, folded : as ``explicitfe run`` tells them.
    gap_mm : region of ``REGIONS_MM`` -> smallest midsagittal distance of tongue and palate there.
    peak_kPa : highest pressure on the palate.
    """

    status: str
    displacement: np.ndarray
    hourglass_share: float
    folded: int
    gap_mm: dict[str, float]
    peak_kPa: float


@dataclass(frozen=True)
class Air:
    """The airway of a posture: formants in Hz, and its pieces from the lowest section to the incisors."""

    F1: float
    F2: float
    F3: float
    pieces: list[Piece]


class Mouth:
    """The built-in tongue at a resolution.

    Parameters
    ----------
    resolution : "coarse", "medium" or "fine".
    """

    def __init__(self, resolution: str = "coarse") -> None:
        self.scenario = TransientScenario(
            title="Posture",
            model=ModelTable(
                name="tongue",
                resolution=resolution,
                material="buchaillard-2009",
                damping=Damping(alpha_per_s=40.0, beta_s=0.03),
                attachment="area",
            ),
            bone=[BoneTable(name=name) for name in ("palate", "jaw", "pharynx")],
            hyoid=HyoidTable(),
            analysis=AnalysisTable(duration_ms=200.0),
        )
        folder = Path(__file__).parent
        bare, anatomy, *_ = assemble(self.scenario.model_copy(update={"bone": []}), folder)
        self.base: Model = replace(bare, bones=bones_of(self.scenario, bare.mesh, folder))
        self.mesh = anatomy.mesh
        muscles = {name: muscle for name, muscle in anatomy.muscles.items() if not muscle.parts}
        self.maxima_N = {name: muscle.max_force_N for name, muscle in muscles.items()}
        self._stresses = {name: fibre_stress(self.mesh, muscle, 1.0, "both", ALWAYS) for name, muscle in muscles.items()}
        self._outside = {name: outside_pull(self.mesh, muscle, 1.0, "both", ALWAYS) for name, muscle in muscles.items()}
        self._outline: PlaneCut = midsagittal(self.mesh)
        self._loop = max(self._outline.loops, key=len)

    def air(self, posture: Posture, settled: Settled, lips: tuple[float, float]) -> Air | None:
        """The airway of a settled posture with lips of an area in mm2 and a length in mm; None if it is closed or not found."""
        table = catalogue.airway("tongue")
        assert table is not None
        tongue, _ = surface_triangles(self.mesh, self.mesh.points + settled.displacement)
        jaw = catalogue.bones("tongue")["jaw"].surface
        corners = jaw.points[jaw.triangles]
        motion = next(bone.motion for bone in self.model(posture).bones if bone.name == "jaw")
        if motion is not None:
            rotation, shift = motion.placement(np.array([1e-3 * posture.duration_ms]))
            corners = corners @ rotation[0].T + shift[0]
        around = bounds_of_air(tongue, self.palate.points[self.palate.triangles], corners, table, 0.0, np.zeros(3))
        pieces = [] if around is None else pieces_between(around)
        if not pieces or min(piece.area_mm2 for piece in pieces) <= 0.0:
            return None
        first, second, third = (one.frequency_hz for one in formants_of(joined(pieces, table.larynx, lips)))
        return Air(first, second, third, pieces)

    @cached_property
    def palate(self) -> TriangleSurface:
        return catalogue.bones("tongue")["palate"].surface

    @cached_property
    def midline(self) -> np.ndarray:
        """Places along the palate, mm, and its points x, z in m: (k, 3)."""
        line = palate_midline(self.palate.points[self.palate.triangles], 0.0)
        assert line is not None
        places = np.arange(0.0, 1e3 * line.length[-1], 0.5)
        return np.column_stack([places, line.at(1e-3 * places)])

    def model(self, posture: Posture) -> Model:
        """The physics of a posture."""
        course = Profile.step(0.0, np.inf, 1e-3 * posture.rise_ms)
        jaw = JawTable(opening_mm=posture.opening_mm, rise_ms=posture.rise_ms)
        motion = jaw_motion(self.scenario.model_copy(update={"jaw": jaw})) if posture.opening_mm else None
        pulling = [(name, force_N) for name, force_N in posture.forces_N.items() if force_N > 0.0]
        outside = [(self._outside[name], force_N) for name, force_N in pulling]
        return replace(
            self.base,
            stresses=tuple(
                replace(self._stresses[name], stress_Pa=force_N * self._stresses[name].stress_Pa, profile=course)
                for name, force_N in pulling
            ),
            pulls=tuple(
                replace(pull, tension_N=tuple(force_N * tension for tension in pull.tension_N), profile=course)
                for pull, force_N in outside
                if pull is not None
            ),
            bones=tuple(replace(bone, motion=motion) if bone.name == "jaw" else bone for bone in self.base.bones),
            attachments=tuple(replace(tie, motion=motion) if tie.name == "jaw" else tie for tie in self.base.attachments),
        )

    def settle(self, posture: Posture) -> Settled:
        """Run a posture to its end, and measure it."""
        model, duration_s = self.model(posture), 1e-3 * posture.duration_ms
        transient = Transient(Simulation(model, threads=1), duration_s)
        ledger, status = Ledger(), "finished"
        try:
            for sample in transient.samples(SAMPLE_EVERY_S):
                ledger.add(sample)
        except RunError:
            assert transient.status is not None
            status = transient.status.state
        u = sample.displacement
        pressure = sample.contact_pressure[[bone.name for bone in model.bones].index("palate")]
        now = self._outline.at(self.mesh.points + u)[self._loop][:, [X, Z]]
        places, gaps = self.midline[:, 0], 1e3 * distances(self.midline[:, 1:], now)
        return Settled(
            status=status,
            displacement=u,
            hourglass_share=ledger.hourglass_share,
            folded=certify(self.mesh.points + u, self.mesh.hexes).folded_count,
            gap_mm={name: float(gaps[(places >= low) & (places < high)].min()) for name, (low, high) in REGIONS_MM.items()},
            peak_kPa=1e-3 * float(pressure.max(initial=0.0)),
        )


def distances(points: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """Distance (k,) of points (k, 2) from a closed outline (m, 2), 0 for those inside of it."""
    from matplotlib.path import Path as Outline

    start, along = outline, np.roll(outline, -1, axis=0) - outline
    offset = points[:, None] - start
    share = np.clip(np.einsum("kmi,mi->km", offset, along) / np.einsum("mi,mi->m", along, along), 0.0, 1.0)
    distance = np.linalg.norm(offset - share[:, :, None] * along, axis=2).min(axis=1)
    return np.where(Outline(outline).contains_points(points), 0.0, distance)
