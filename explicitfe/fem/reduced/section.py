"""A section of revolution under a tool in few unknowns, made from some runs of the full one.

The full section has thousands of unknowns. Runs of it span a space of few modes (proper orthogonal decomposition), in which the
equations of the full section are solved (Galerkin projection). Internal forces come from few Gauss points with weights of their
own, and the memory of the material exists at these points only. Contact is computed at all points of the surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from explicitfe.fem.effects import Effect
from explicitfe.fem.forces import response
from explicitfe.fem.inputs.specimen import SpecimenTable, ToolTable
from explicitfe.fem.materials.yeoh import Yeoh
from explicitfe.fem.reduced.cubature import Cubature, cubature_of
from explicitfe.fem.reduced.kernel import AGE, COORDINATE, GIVING, LARGEST, STATE, Reduced, follower, work_arrays
from explicitfe.fem.reduced.modes import Modes, modes_of
from explicitfe.fem.reduced.snapshots import Programme, snapshots_of
from explicitfe.fem.solve.point import blocks_at_rest, numbers_along
from explicitfe.fem.solve.quad9 import work_for
from explicitfe.fem.solve.revolution import LONGEST_SECTION_EXTRAPOLATION, TOUCHING_SHARE
from explicitfe.fem.solve.section import RevolvedSection
from explicitfe.fem.solve.section_tissue import SectionTissue, incompressible, is_isochoric, tissue_in_section
from explicitfe.platform.compiled.simd import WIDTH
from explicitfe.platform.errors import InputError, RunError

# Modes of displacements and pressures, Gauss points at most, and the error of the cubature.
MODE_COUNT, PRESSURE_COUNT, MOST_POINTS, CUBATURE_TOLERANCE = 16, 12, 400, 3e-4
# Poisson's ratio of the law at the points, whose pressure is left out: it would be a small difference of large numbers.
LIGHT_POISSON_RATIO = 0.3


class Followed(NamedTuple):
    """Equilibria of a reduced section at n instants.

    Attributes
    ----------
    force_N, displacement_m : (n,) of the tool and of the machine since first touch.
    yielded_m : (n,) part of the tool's depth that the springs of the contact give way by.
    unknowns : (n, N), see reduced/kernel.py.
    """

    force_N: np.ndarray
    displacement_m: np.ndarray
    yielded_m: np.ndarray
    unknowns: np.ndarray


class ReducedSection:
    """A section under a tool in few unknowns.

    Parameters
    ----------
    specimen, tool : tables of the test.
    programmes : runs of the full section that span the modes: tissues and courses like those that are asked for later.
    fineness : divides the element sizes.
    modes, pressures : number of modes of displacements and of pressures.
    points, tolerance : number of Gauss points at most, and the error of the internal forces that ends the search for more.

    Raises
    ------
    InputError : a tool that is glued on, or an effect that changes the volume.
    RunError : a state of the full section is not reached.
    """

    def __init__(
        self,
        specimen: SpecimenTable,
        tool: ToolTable,
        programmes: Sequence[Programme],
        fineness: float = 1.0,
        *,
        modes: int = MODE_COUNT,
        pressures: int = PRESSURE_COUNT,
        points: int = MOST_POINTS,
        tolerance: float = CUBATURE_TOLERANCE,
    ) -> None:
        for programme in programmes:
            _refuse(tool, programme.effects)
        self.specimen, self.tool, self.fineness = specimen, tool, fineness
        snapshots = snapshots_of(specimen, tool, programmes, fineness)
        self.section: RevolvedSection = snapshots.section
        self.modes: Modes = modes_of(snapshots, modes, pressures)
        self.cubature: Cubature = cubature_of(snapshots, self.modes, points, tolerance)
        surface = self.section.surface
        nodes, own = np.unique(surface.nodes, return_inverse=True)
        self._surface = surface._replace(nodes=own.reshape(surface.nodes.shape))
        dofs = np.stack([2 * nodes, 2 * nodes + 1], axis=1).ravel()
        self._lifted = np.ascontiguousarray(self.modes.displacements[dofs])
        at = self.cubature.points
        self._gradients = np.ascontiguousarray(self.modes.gradients[at].reshape(5 * len(at), -1))

    def follow(
        self, law: Yeoh, effects: Sequence[Effect], time_s: np.ndarray, imposed: np.ndarray, *, by_force: bool = False
    ) -> Followed:
        """Follow a programme from rest.

        Parameters
        ----------
        law, effects : the tissue.
        time_s, imposed : (n,) instants, and forces [N] or displacements of the machine since first touch [m] there.

        Raises
        ------
        InputError : an effect that changes the volume or the mesh.
        RunError : a state is not reached.
        """
        _refuse(self.tool, effects)
        tissue = tissue_in_section(self.section, self.specimen.layer_mm, self.specimen, self.tool, law, effects)
        if tissue.section is not self.section:
            raise InputError("a reduced section has one mesh, and another layer needs another; make a reduced section for it.")
        return _Run(self, tissue, incompressible(law)).over(np.asarray(time_s, dtype=float), imposed, by_force)


class _Run:
    """One programme of a tissue in a reduced section."""

    def __init__(self, body: ReducedSection, tissue: SectionTissue, law: Yeoh) -> None:
        at, modes, section = body.cubature.points, body.modes, body.section
        self.tissue = tissue
        base = modes.displacements[section.base_dofs]
        springs = np.einsum("kan,kab,kbm->nm", base, tissue.springs, base) if len(tissue.springs) else 0.0
        count = modes.displacements.shape[1]
        self.reduced = Reduced(
            gradients=body._gradients,
            pressures=law.shear_modulus_Pa * modes.at_points[at],
            weights=body.cubature.weights,
            linear=np.zeros((9, 3)),
            surface=body._surface,
            lifted=body._lifted,
            springs=np.zeros((count, count)) + springs,
            dead=tissue.dead @ modes.displacements,
            tool=tissue.profile,
        )
        light = law.model_copy(update={"poisson": LIGHT_POISSON_RATIO})
        self.blocks = blocks_at_rest(light, tissue.materials, len(at))
        own = tissue.blocks.constants.transpose(0, 2, 1).reshape(-1, tissue.blocks.constants.shape[1])[at]
        lanes = np.resize(own, (len(self.blocks.nodes) * WIDTH, own.shape[1]))
        lanes[len(at) :], lanes[:, -1] = own[-1], light.constants()[-1]
        self.blocks.constants[:] = lanes.reshape(-1, WIDTH, own.shape[1]).transpose(0, 2, 1)
        self.work, self.points = work_arrays(self.reduced), work_for(len(at), len(self.blocks.nodes))
        self.kernel = follower(law.law, response.layout_of(tissue.materials))
        self.history = np.zeros((3, len(self.work.rows)))
        self.x = self.history[0]
        self.state = np.zeros(STATE)
        self.state[GIVING], self.state[LARGEST] = 1.0, law.shear_modulus_Pa * section.height**2

    def over(self, time_s: np.ndarray, imposed: np.ndarray, by_force: bool) -> Followed:
        tissue, touch = self.tissue, 0.0
        start = time_s[:1]
        if tissue.dead.any():
            self.x[-1] = -tissue.section.height
            self._advance(start, self.x[-1:].copy(), (1.0, 0.0))
            touch = self.x[-1] = self._first_touch()
            tissue.anchors[:, 2] = touch
        rig = tissue.rig.compliance_m_N
        if tissue.rig.preload_N > 0.0:
            answers = self._advance(start, np.array([tissue.rig.preload_N]), (0.0, 1.0))
            touch = answers[0, -1] + rig * answers[0, -2]
        if by_force:
            least = TOUCHING_SHARE * np.maximum.accumulate(np.abs(imposed))
            answers = self._advance(time_s, np.maximum(imposed, least), (0.0, 1.0))
        else:
            answers = self._advance(time_s, imposed + touch, (1.0, rig))
        force, depth, unknowns = answers[:, -2], answers[:, -1], answers[:, :-2]
        return Followed(
            np.asarray(imposed, dtype=float) if by_force else force,
            depth + rig * force - touch,
            unknowns[:, -1] - depth,
            unknowns,
        )

    def _advance(self, time_s: np.ndarray, goals: np.ndarray, control: tuple[float, float]) -> np.ndarray:
        answers = np.zeros((len(goals), len(self.x) + 2))
        self.state[AGE] = -1.0
        self.state[COORDINATE] = 0.0 if control[0] == 0.0 else self.x[-1]
        numbers = numbers_along(self.tissue.materials, np.diff(time_s, prepend=time_s[0]))
        done = self.kernel(
            np.ascontiguousarray(goals, dtype=float),
            numbers,
            _ahead(time_s, goals),
            np.array(control),
            self.history,
            self.state,
            self.tissue.anchors,
            self.reduced,
            self.points,
            self.blocks,
            self.work,
            answers,
        )
        if done < len(goals):
            raise RunError(f"the reduced section finds no equilibrium at {time_s[done]:.4g} s.")
        return answers

    def _first_touch(self) -> float:
        """Depth of the tool at which it touches the sagged surface."""
        surface = self.reduced.surface
        moved = surface.places + np.einsum("ka,kai->ki", surface.shape, self.work.moved.reshape(-1, 2)[surface.nodes])
        height, flat, edge, platen = self.reduced.tool[:4]
        out = np.zeros(len(moved)) if platen else np.maximum(moved[:, 0] - flat, 0.0)
        rise = edge - np.sqrt(np.maximum(edge**2 - out**2, 0.0))
        return float(np.min((height + rise - moved[:, 1])[out <= edge]))


def _ahead(time_s: np.ndarray, goals: np.ndarray) -> np.ndarray:
    """Weights (n, 3) of the last three states in the start of a search: a parabola along a ramp or a hold, where they lead on."""
    weights = np.zeros((len(goals), 3))
    weights[:, 0] = 1.0
    ways, waits = np.diff(goals), np.diff(time_s)
    with np.errstate(all="ignore"):
        ratio = np.where(ways[1:] == 0.0, np.where(ways[:-1] == 0.0, waits[1:] / waits[:-1], 0.0), ways[1:] / ways[:-1])
    ratio = np.where(np.isfinite(ratio) & (ratio > 0.0) & (ratio <= LONGEST_SECTION_EXTRAPOLATION), ratio, 0.0)
    for row, r in enumerate(ratio, start=2):
        q = ratio[row - 3] if row > 2 else 0.0
        if r > 0.0 and q > 0.0:
            back = -1.0 - 1.0 / q
            weights[row] = (r + 1.0) * (r - back) / -back, r * (r - back) / (1.0 + back), r * (r + 1.0) / (back * (back + 1.0))
        elif r > 0.0:
            weights[row, :2] = 1.0 + r, -r
    return weights


def _refuse(tool: ToolTable, effects: Sequence[Effect]) -> None:
    """Refuse what a reduced section does not know."""
    if tool.shape == "bonded-disc":
        raise InputError("a reduced section knows no tool that is glued on; use a Revolution.")
    if not is_isochoric(effects):
        raise InputError("a reduced section keeps its volume, and an effect changes it; use a Revolution.")
