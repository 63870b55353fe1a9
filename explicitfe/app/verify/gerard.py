"""Findings of Gérard et al. (2005), section 5, at all probes and on both tissues: the claim, its table and the criteria.

Gérard, Ohayon, Luboz, Perrier, Payan (Med. Eng. Phys. 27:884-892, 2005): the posterior genioglossus with a small force of the
anterior one gives [i], forward and high in front, with a groove. The posterior alone makes no groove. The anterior alone moves
the tongue down and back and grooves it. The superior longitudinal raises the tip and leaves the dorsum high; the middle
genioglossus lowers the dorsum.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from explicitfe.app.verify.claim import ClaimFigure, Workshop
from explicitfe.results.measure.document import Measures

TISSUES = {"living": "buchaillard-2009", "cadaver": "gerard-2005"}
POINTS = ("tip", "blade", "front", "dorsum", "back")
IN_FRONT = POINTS[:4]
WHILE_CLOSED = "analysis.duration_ms=140"  # SL pulls until 150 ms
VOWEL_I, GGP = "[i]: GGp 2 N, GGa 0.2 N", "GGp 2 N"
# Gesture -> scenario and settings. The paper's GGp comprises our GGp and GGh.
GESTURES: dict[str, tuple[str, ...]] = {
    VOWEL_I: ("vowel-i",),
    "[i]: GGp 2 N, GGa 0.5 N": ("vowel-i", "muscle.GGa.force_N=0.5"),
    GGP: ("vowel-i", "muscle.GGa.force_N=0"),
    "jaw of [i] alone": ("vowel-i", *(f"muscle.{muscle}.force_N=0" for muscle in ("GGp", "GGh", "GGa"))),
    "GGa 0.5 N": ("gga-alone",),
    "SL 0.5 N": ("sl-alone",),
    "SL, jaw of [t]": ("alveolar-t-sl", WHILE_CLOSED),
    "GGm 1 N": ("ggm-alone",),
}
# Smallest displacement that counts as one, and smallest depth of a groove, mm: half of the last digit of the table.
VISIBLE_MM = 0.05
# The dorsum "remains high" if it sinks by no more than this, mm.
HIGH_MM = 1.0


@dataclass(frozen=True)
class Findings:
    """The gestures on one tissue, "living" or "cadaver"."""

    work: Workshop
    tissue: str

    @cached_property
    def measures(self) -> dict[str, Measures]:
        """Gesture -> its measures at the end."""
        material = f"model.material={TISSUES[self.tissue]}"
        return {name: self.work.measures(*run, material) for name, run in GESTURES.items()}

    def displacement_mm(self, gesture: str, point: str) -> tuple[float, float]:
        """Forward and up."""
        motion = self.measures[gesture].points[point]
        return motion.forward_mm, motion.up_mm

    def groove_mm(self, gesture: str) -> float:
        """Depth of the groove at the front, relative to rest."""
        return self.measures[gesture].grooves["front"].depth_mm

    def criteria(self, gesture: str) -> Iterator[tuple[str, float, bool]]:
        """Each statement of the paper on a gesture, the figure [mm] that is compared with it, and whether it is met."""
        if gesture.startswith(("[i]", GGP)):
            for point in IN_FRONT:
                for direction, moved in zip(("forward", "up"), self.displacement_mm(gesture, point), strict=True):
                    yield f"{point} {direction}", moved, moved > VISIBLE_MM
            groove = self.groove_mm(gesture)
            if gesture == GGP:
                yield "no groove", groove, groove < VISIBLE_MM
            else:
                yield "groove", groove, groove > self.groove_mm(GGP) + VISIBLE_MM
        elif gesture.startswith("GGa"):
            for point in IN_FRONT:
                forward, up = self.displacement_mm(gesture, point)
                yield f"{point} back", forward, forward < -VISIBLE_MM
                yield f"{point} down", up, up < -VISIBLE_MM
            yield "groove", self.groove_mm(gesture), self.groove_mm(gesture) > VISIBLE_MM
        elif gesture.startswith("SL"):
            tip, dorsum = (self.displacement_mm(gesture, point)[1] for point in ("tip", "dorsum"))
            yield "tip up", tip, tip > VISIBLE_MM
            yield "dorsum high", dorsum, dorsum > -HIGH_MM
        elif gesture.startswith("GGm"):
            dorsum = self.displacement_mm(gesture, "dorsum")[1]
            yield "dorsum down", dorsum, dorsum < -VISIBLE_MM

    def unmet(self, gesture: str) -> list[str]:
        """Statements on a gesture that are not met, with their figures [mm]."""
        return [f"{what} {figure:+z.1f}" for what, figure, met in self.criteria(gesture) if not met]


def vowel_i(work: Workshop) -> ClaimFigure:
    """Number of statements on [i] and on GGp that are not met on living tissue."""
    findings = Findings(work, "living")
    unmet = [f"{gesture}: {what}" for gesture in (VOWEL_I, GGP) for what in findings.unmet(gesture)]
    moved = (
        f"{point} {forward:+.1f}, {up:+.1f}" for point in IN_FRONT for forward, up in [findings.displacement_mm(VOWEL_I, point)]
    )
    return ClaimFigure("; ".join([f"[i], forward and up in mm: {', '.join(moved)}", *unmet]), float(len(unmet)))
