"""Whether a test under a tool can tell an effect from all others, by the implicit solver on a coarse mesh.

Every effect is represented by what it changes (its secant) at a few strengths, all as forces at the true depths. A rival is the
best non-negative sum of its secants beside any change of C10 and C20. What remembers is a factor on the elastic force here:
a fading integral for relaxation, a function of the past energy for softening.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import nnls
from scipy.special import erf

from explicitfe.platform.errors import RunError
from studies.blind.foreign.law import HiddenTissue
from studies.blind.foreign.tool_tests import ColumnNoise, ElasticCurve, RigReading, ToolTest
from studies.blind.identifiable import Separation

COARSE_FINENESS = 0.4
COARSE_POINTS = 9  # of an elastic curve
SLOPE_STEP_SHARE = 0.05  # of C10: the step of the derivative by C20
PROGRAMME_PARTS = 6  # instants from row to row of what fades
READING_SHARE = 0.02  # of the largest force, displacement or time: the size of the secants of readings


class Secants:
    """The changes that effects make in the forces of planned tests.

    Parameters
    ----------
    depth_mm : the largest depth of each test, about.
    """

    def __init__(self, tests: Sequence[ToolTest], tissue: HiddenTissue, depth_mm: Sequence[float]) -> None:
        self.tests, self.tissue, self.depth_mm = list(tests), tissue, list(depth_mm)
        self.height_mm = {test.specimen.height_mm for test in tests}
        self.plain = self._curves(tissue)
        self.depths = [
            curve.depth(np.maximum(test.imposed(test.rows), 0.0)) if test.by_force else test.imposed(test.rows)
            for test, curve in zip(tests, self.plain, strict=True)
        ]
        self.forces = [curve.force(depth) for curve, depth in zip(self.plain, self.depths, strict=True)]
        self.slopes = [
            (curve.force(depth + 0.01) - curve.force(depth - 0.01)) / 0.02
            for curve, depth in zip(self.plain, self.depths, strict=True)
        ]

    def _curves(self, tissue: HiddenTissue, friction: float = 0.0) -> list[ElasticCurve]:
        curves: dict[object, ElasticCurve] = {}
        for test, depth in zip(self.tests, self.depth_mm, strict=True):
            key = test.specimen, test.tool
            if key not in curves:
                tool = replace(test.tool, friction=friction)
                curves[key] = ElasticCurve(test.specimen, tool, tissue, depth, COARSE_FINENESS, COARSE_POINTS)
        return [curves[test.specimen, test.tool] for test in self.tests]

    @property
    def largest_force_N(self) -> float:
        return max(float(force.max()) for force in self.forces)

    @property
    def largest_depth_mm(self) -> float:
        return max(float(depth.max()) for depth in self.depths)

    @property
    def longest_s(self) -> float:
        return max(float(test.rows[-1]) for test in self.tests)

    def tissue_change(self, tissue: HiddenTissue, friction: float = 0.0) -> np.ndarray:
        """Change of the forces (n,) [N] by another tissue."""
        curves = self._curves(tissue, friction)
        return np.concatenate([c.force(d) - f for c, d, f in zip(curves, self.depths, self.forces, strict=True)])

    def reading_change(self, reading: RigReading) -> np.ndarray:
        """Change by what stands between tool and reading (n,) [N], to first order in the rig's compliance."""
        changes = []
        for test, curve, depth, force in zip(self.tests, self.plain, self.depths, self.forces, strict=True):
            at = depth + reading.offset_mm
            for _ in range(20 if reading.compliance_mm_N else 0):
                at = 0.5 * (at + depth + reading.offset_mm - reading.compliance_mm_N * curve.force(at))
            change = reading.read(curve.force(at), test.rows) - force
            if reading.lag_s:
                change += np.interp(test.rows - reading.lag_s, test.rows, force) - force
            changes.append(change)
        return np.concatenate(changes)

    def relaxation(self, g: float, tau_s: float) -> np.ndarray:
        """Change by a term of relaxation (n,) [N]."""
        changes = []
        for test, curve, force in zip(self.tests, self.plain, self.forces, strict=True):
            k = np.arange((len(test.rows) - 1) * PROGRAMME_PARTS + 1) / PROGRAMME_PARTS
            t = np.interp(k, np.arange(len(test.rows)), test.rows)
            x = np.maximum(test.imposed(t), 0.0)
            F = x if test.by_force else curve.force(x)
            y = np.diff(t) / tau_s
            Q = np.zeros(len(t))
            for i, step in enumerate(np.diff(F)):
                Q[i + 1] = np.exp(-y[i]) * Q[i] - np.expm1(-y[i]) / y[i] * g * step
            lost = (Q - g * F)[::PROGRAMME_PARTS]
            changes.append(np.where(force > 0.0, np.maximum(lost, -force), 0.0))
        return np.concatenate(changes)

    def softening(self, inverse_r: float, width_share: float) -> np.ndarray:
        """Change by softening (n,) [N], by the work of the tool: the width is a share of its largest."""
        changes = []
        for curve, depth, force in zip(self.plain, self.depths, self.forces, strict=True):
            places = np.linspace(0.0, curve.end_mm, 200)
            F = curve.force(places)
            work = np.interp(depth, places, np.concatenate([[0.0], np.cumsum(0.5 * (F[1:] + F[:-1]) * np.diff(places))]))
            largest = np.maximum.accumulate(work)
            changes.append(-inverse_r * force * erf((largest - work) / (width_share * max(work.max(), 1e-12))))
        return np.concatenate(changes)

    # ---- rivals ----

    def rivals(self) -> dict[str, list[np.ndarray]]:
        """The secants of every effect that could stand for another one; one that cannot be computed stands for nothing."""
        tissue, C10 = self.tissue, self.tissue.C10_Pa
        H, F, d, span = max(self.height_mm), self.largest_force_N, self.largest_depth_mm, self.longest_s
        give = 1e3 * H / (2.0 * C10)  # mm/kPa
        changed: dict[str, list[tuple[HiddenTissue, float]]] = {
            "third-yeoh": [(replace(tissue, C30_Pa=0.3 * C10), 0.0)],
            "compressible": [(replace(tissue, poisson=nu), 0.0) for nu in (0.49, 0.45)],
            "stiffness-gradient": [(replace(tissue, gradient=g), 0.0) for g in (0.4, -0.4)],
            "layer": [(replace(tissue, layer=layer), 0.0) for layer in ((1.0, 2.5), (2.5, 2.0), (2.0, 0.5))],
            "base-slip": [(replace(tissue, base_compliance_mm_kPa=share * give), 0.0) for share in (0.2, 2.0)],
            "gravity": [(replace(tissue, gravity_m_s2=9.81), 0.0)],
            "friction": [(tissue, coefficient) for coefficient in (0.1, 0.4)],
        }
        columns: dict[str, list[np.ndarray]] = {}
        for name, variants in changed.items():
            for variant, friction in variants:
                try:
                    columns.setdefault(name, []).append(self.tissue_change(variant, friction))
                except RunError:
                    continue
        size = READING_SHARE
        readings = {
            "contact-offset": [RigReading(offset_mm=sign * size * d) for sign in (1.0, -1.0)],
            "compliance": [RigReading(compliance_mm_N=share * d / F) for share in (size, 0.2)],
            "force-offset": [RigReading(force_offset_N=sign * size * F) for sign in (1.0, -1.0)],
            "force-drift": [RigReading(force_drift_N_s=sign * size * F / span) for sign in (1.0, -1.0)],
            "lag": [RigReading(lag_s=sign * 0.005 * span) for sign in (1.0, -1.0)],
        }
        for name, several in readings.items():
            columns[name] = [self.reading_change(reading) for reading in several]
        columns["viscoelastic"] = [self.relaxation(0.2, share * span) for share in (0.002, 0.01, 0.05, 0.2, 0.6, 2.0)]
        columns["softening"] = [self.softening(0.3, share) for share in (0.02, 0.1, 0.5)]
        return columns

    def separation(self, true: np.ndarray, hidden: Sequence[str], noise: ColumnNoise) -> Separation:
        """How far a change of the forces stays from the law alone and from each other effect."""
        sd = np.concatenate([np.hypot(noise.force_N, slope * noise.displacement_mm) for slope in self.slopes])
        step = SLOPE_STEP_SHARE * self.tissue.C10_Pa
        constants = [np.concatenate(self.forces), self.tissue_change(replace(self.tissue, C20_Pa=self.tissue.C20_Pa + step))]
        # Under an imposed force a row without one determines nothing.
        determined = np.concatenate([(f > 0.0) | (not test.by_force) for f, test in zip(self.forces, self.tests, strict=True)])
        sd = np.where(determined, sd, np.inf)
        Q, _ = np.linalg.qr(np.column_stack(constants) / sd[:, None])

        def apart(columns: Sequence[np.ndarray]) -> float:
            target = true / sd
            target = target - Q @ (Q.T @ target)
            if not columns:
                return float(target @ target)
            prints = np.column_stack(columns) / sd[:, None]
            prints = prints - Q @ (Q.T @ prints)
            return float(nnls(prints / np.maximum(np.linalg.norm(prints, axis=0), 1e-12), target)[1] ** 2)

        baseline = apart([])
        return Separation(baseline, {name: apart(c) for name, c in self.rivals().items() if [name] != list(hidden)})
