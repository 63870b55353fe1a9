"""A stored run as an animated scene: body, bones, muscle fibres and the shape at rest, at any of its samples.

Lengths in a scene are in mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from explicitfe.app.view.context import ContextPart, context_of
from explicitfe.app.view.mouth import drawn_bones, is_mouth, teeth_of
from explicitfe.app.view.muscles import activation, muscles_of
from explicitfe.app.view.palette import BONE, BONE_EDGE, FIBRE_AT_REST, FIBRE_PULLING, IVORY, MUCOSA, TONGUE
from explicitfe.app.view.scene.body import BodySurface
from explicitfe.app.view.scene.carried import CarriedPoints, joined
from explicitfe.app.view.scene.shown_field import ShownField, shown_field
from explicitfe.app.view.scene.viewpoint import Viewpoint, aim, viewpoint
from explicitfe.platform.errors import InputError, shortened
from explicitfe.results.files import Result, StoredBone
from explicitfe.results.measure.sections import X, Y, middle

if TYPE_CHECKING:
    import pyvista

# Bones are shown up to this distance from the body, because the tongue would be tiny in a whole skull.
BONES_AROUND_MM = 12.0
# What stands between the camera and the tongue is transparent.
NEAR_BONE_OPACITY, NEAR_TEETH_OPACITY, NEAR_CONTEXT_OPACITY = 0.12, 0.25, 0.2
CLEAR_OF_BONE_MM = 2.0  # more than crowns stand out from a bone
LARGEST_HOLE_MM = 100.0  # in a bone, which is closed for display
GHOST_OPACITY, GHOST_COLOUR = 0.7, "#303030"
# Length of a dash as a share of the body, and share of a line that dashes cover.
DASH_LENGTH_SHARE, DASH_SHARE = 0.016, 0.6
# The outline at rest and cut bones are drawn this share of the body in front of the cut face.
BEFORE_FACE_SHARE = 0.004
PARTS = ("bones", "fibres", "rest", "context")  # that a scene may lack
VIEW_OF_SPECIMEN = "oblique"  # It has no midsagittal plane.
# Faces of a bone that meet at less than this angle are shaded as one.
BONE_EDGE_DEG = 50.0
# Fibres run inside the body; they are drawn in front of everything.
ON_TOP_UNITS = -66000.0
ON_SURFACE_UNITS = -60.0


@dataclass(frozen=True)
class Look:
    """Contents and view of a scene.

    Attributes
    ----------
    view : a name of ``VIEWPOINTS``.
    field : a stored field, or ``NO_FIELD``.
    bones, fibres, at_rest, context : whether bones, muscle fibres, the shape at rest, and lips, hyoid bone and larynx are shown.
    """

    view: str = "midsagittal"
    field: str = "displacement"
    bones: bool = True
    fibres: bool = True
    at_rest: bool = True
    context: bool = True


def look_of(view: str | None, kind: str, field: str, without: Sequence[str]) -> Look:
    """What is shown of a result of this kind of analysis; see :func:`explicitfe.view`.

    Raises
    ------
    InputError : ``without`` names no part of a scene, or there is no such view.
    """
    for part in without:
        if part not in PARTS:
            raise InputError(f'`without` "{shortened(part)}" is not valid; use {", ".join(PARTS[:-1])} or {PARTS[-1]}.')
    view = view or (VIEW_OF_SPECIMEN if kind == "relaxation" else Look.view)
    viewpoint(view)
    return Look(view, field, *(part not in without for part in PARTS))


@dataclass(frozen=True)
class _Fibres:
    """The fibres of a muscle, drawn, and the points that the mesh carries."""

    drawn: pyvista.PolyData
    points: CarriedPoints
    actor: pyvista.Actor


class Scene:
    """A run in a plotter of pyvista; :meth:`show` moves everything to a sample, :attr:`body_mapper` colours the body.

    Parameters
    ----------
    result : an open result, which is read whenever a sample is shown.
    steps : samples that will be shown, for which colours and camera are chosen.

    Raises
    ------
    InputError : the result has no such field, or there is no such view.
    """

    def __init__(self, result: Result, steps: Sequence[int], look: Look, plotter: Any) -> None:
        self.result, self.look, self.plotter = result, look, plotter
        self.view: Viewpoint = viewpoint(look.view)
        self.field: ShownField | None = shown_field(result, look.field, steps)
        mesh = result.mesh
        self._middle_mm = 1e3 * middle(mesh)
        reached = [1e3 * (mesh.points + result.displacement(step)) for step in steps]
        self._extent = np.concatenate([[points.min(axis=0), points.max(axis=0)] for points in [1e3 * mesh.points, *reached]])
        self.framed = [1e3 * mesh.points, *reached]
        self._has_mouth = is_mouth(result)
        self._body = BodySurface(mesh, middle(mesh) if self.view.cut else None, round_edges=self._has_mouth)
        self.body_mapper = self._add_body().mapper
        if look.at_rest:
            self._add_shape_at_rest()
        self._bones = self._add_bones() if look.bones else {}
        self._fibres = self._add_fibres() if look.fibres else {}
        self._context: dict[str, ContextPart] = {}
        self._context_actors: dict[str, list[pyvista.Actor]] = {}
        if look.context:
            for step in (steps[0], steps[-1]):
                self._place_context(step)

    @property
    def has_fibres(self) -> bool:
        """Whether fibres of a muscle are shown."""
        return bool(self._fibres)

    def aim(self, margins: tuple[float, float, float]) -> None:
        """Place the camera so that it shows everything at all samples; ``margins`` as in :func:`viewpoint.aim`."""
        aim(self.plotter, self.view, np.concatenate(self.framed), margins)

    def show(self, step: int) -> None:
        """Move everything to its place at a sample."""
        displacement = self.result.displacement(step)
        self._body.move(displacement)
        if self.field is not None:
            self._body.paint(self.field, self.result, step)
        for name, actors in self._bones.items():
            rotation, shift = self.result.placement(name, step)
            matrix = np.eye(4)
            matrix[:3, :3], matrix[:3, 3] = rotation, 1e3 * shift
            for actor in actors:
                actor.user_matrix = matrix
        if self.look.context:
            self._place_context(step)
        pulls = self.pulls(step)
        for number, fibres in self._fibres.items():
            fibres.drawn.points = 1e3 * fibres.points.places(displacement)
            fibres.actor.prop.color = mixed(FIBRE_AT_REST, FIBRE_PULLING, pulls[number])

    def pulls(self, step: int) -> list[float]:
        """Activation of each muscle at a sample, as a share of its force."""
        time_ms = 1e3 * float(self.result.times[step])
        shares = []
        for muscle in muscles_of(self.result):
            times, scales = activation(muscle, max(time_ms, 1e-6))
            shares.append(float(np.clip(np.interp(time_ms, times, scales), 0.0, 1.0)) if muscle["force_N"] > 0.0 else 0.0)
        return shares

    # ---- inside ----

    def _add_body(self) -> pyvista.Actor:
        body, field = self._body, self.field
        add = partial(
            self.plotter.add_mesh,
            body.drawn,
            smooth_shading=True,
            ambient=0.25,
            diffuse=0.8,
            specular=0.15,
            specular_power=12.0,
            reset_camera=False,
        )
        if not self._has_mouth:
            lines = self.plotter.add_mesh(
                body.lines, color="#202020", opacity=0.3, line_width=1, lighting=False, reset_camera=False
            )
            before_faces(lines, ON_SURFACE_UNITS)
        if field is None:
            return add(color=TONGUE)
        body.drawn.point_data["shown"] = np.zeros(body.drawn.n_points)
        return add(scalars="shown", clim=field.limits, cmap=field.colours, show_scalar_bar=False)

    def _add_shape_at_rest(self) -> None:
        """A dashed outline of the cut, or of the middle of a tongue seen from the side; else the silhouette of the body."""
        if self.view.cut or (self._has_mouth and self.view.axes[2][Y] == -1.0):
            size = float(np.ptp(self._extent, axis=0).max())
            before = (BEFORE_FACE_SHARE if self.view.cut else 1.0) * size * self.view.axes[2]
            cut = self._body if self.view.cut else BodySurface(self.result.mesh, self._middle_mm / 1e3, self._has_mouth)
            self.plotter.add_mesh(
                _segments(dashes(cut.outline(), DASH_LENGTH_SHARE * size) + before),
                color=GHOST_COLOUR,
                line_width=2,
                lighting=False,
                reset_camera=False,
            )
            return
        self.plotter.add_silhouette(self._body.drawn.copy(), color=GHOST_COLOUR, line_width=1.5, opacity=GHOST_OPACITY)

    def _add_bones(self) -> dict[str, list[pyvista.Actor]]:
        """The bones near the body, and teeth: solid behind the plane of the view.

        In front of it teeth are looked through, and bones where no mouth is known; the bones of a mouth are cut away there.
        """
        import pyvista

        teeth = teeth_of(self.result)
        actors: dict[str, list[pyvista.Actor]] = {}
        for name, bone in drawn_bones(self.result).items():
            surface = near_part(bone, self._extent)
            if surface is None:
                continue
            normal, origin = self._plane(surface)
            before = None if self._has_mouth else NEAR_BONE_OPACITY
            actors[name] = self._add_part(surface, normal, origin, before, MUCOSA if self._has_mouth else BONE)
            edge = surface.slice(normal=normal, origin=origin)
            if edge.n_points:
                line = self.plotter.add_mesh(edge, color=BONE_EDGE, line_width=2, lighting=False, reset_camera=False)
                actors[name].append(line)
            if name in teeth:
                crowns = pyvista.PolyData.from_regular_faces(1e3 * teeth[name].points, teeth[name].triangles)
                before = None if self.view.before is None else NEAR_TEETH_OPACITY
                actors[name] += self._add_part(crowns, normal, origin, before, IVORY, specular=0.3, specular_power=25.0)
        return actors

    def _place_context(self, step: int) -> None:
        """What is around the tongue at a sample: seen as teeth are. A part that has moved or changed its shape is drawn anew."""
        import pyvista

        for name, part in context_of(self.result, step).items():
            before = self._context.get(name)
            if before is not None and np.array_equal(before.points, part.points):
                continue
            for actor in self._context_actors.get(name, ()):
                self.plotter.remove_actor(actor, reset_camera=False, render=False)
            surface = pyvista.PolyData.from_regular_faces(1e3 * part.points, part.triangles)
            opacity = None if self.view.before is None else NEAR_CONTEXT_OPACITY
            self._context[name] = part
            self._context_actors[name] = self._add_part(surface, *self._plane(surface), opacity, part.colour)

    def _plane(self, bone: pyvista.PolyData) -> tuple[np.ndarray, np.ndarray]:
        """Normal and point of the plane in front of which a bone does not hide the body."""
        low, high = self._extent.min(axis=0), self._extent.max(axis=0)
        if self.view.before is None:
            eye = self.view.axes[2]
            reach = bone.points @ eye
            is_before = reach.min() > 0.5 * (low + high) @ eye
            return eye, (reach.min() - CLEAR_OF_BONE_MM if is_before else reach.max() + CLEAR_OF_BONE_MM) * eye
        normal = np.array(self.view.before)
        return normal, np.array([0.5 * (low[X] + high[X]), self._middle_mm, 0.0])

    def _add_part(
        self,
        surface: pyvista.PolyData,
        normal: np.ndarray,
        origin: np.ndarray,
        before_opacity: float | None,
        colour: str,
        **shine: float,
    ) -> list[pyvista.Actor]:
        """A surface around the body, solid behind a plane; None for nothing in front of it."""
        behind, actors = cut_off(surface, normal, origin), []
        add = partial(self.plotter.add_mesh, color=colour, reset_camera=False, smooth_shading=True, split_sharp_edges=True)
        add = partial(add, feature_angle=BONE_EDGE_DEG, ambient=0.5, diffuse=0.55, **shine)
        if behind.n_points:
            self.framed.append(np.array(behind.points))
            actors.append(add(behind))
        if before_opacity is not None and not self.view.cut:
            before = surface.clip(normal=normal, origin=origin, invert=False)
            if before.n_points:
                self.framed.append(np.array(before.points))
                actors.append(add(before, opacity=before_opacity))
        return actors

    def _add_fibres(self) -> dict[int, _Fibres]:
        """The fibres of each muscle, in a cut view those of the half that is shown; muscle's number -> lines and their actor."""
        mesh, drawn = self.result.mesh, {}
        for number, lines in enumerate(self.result.fibres):
            shown = [line for line in lines if not self.view.cut or 1e3 * line.position[:, Y].mean() >= self._middle_mm - 1e-6]
            if not shown:
                continue
            points = joined([CarriedPoints.of(mesh, line) for line in shown])
            polyline = _polylines(1e3 * points.reference, [len(line) for line in shown])
            actor = self.plotter.add_mesh(polyline, color=FIBRE_AT_REST, line_width=3, lighting=False, reset_camera=False)
            before_faces(actor, ON_TOP_UNITS)
            drawn[number] = _Fibres(polyline, points, actor)
        return drawn


def share_scenes(scenes: Sequence[Scene], margins: tuple[float, float, float]) -> None:
    """Give scenes of one view and field the same camera and colour scale; ``margins`` as in :func:`viewpoint.aim`."""
    points = np.concatenate([part for scene in scenes for part in scene.framed])
    limits = np.array([scene.field.limits for scene in scenes if scene.field is not None])
    for scene in scenes:
        aim(scene.plotter, scene.view, points, margins)
        if scene.field is not None:
            scene.body_mapper.scalar_range = (limits[:, 0].min(), limits[:, 1].max())


def mixed(at_none: str, at_all: str, share: float) -> tuple[float, float, float]:
    """The colour between two, such as "#FF0000", at a share of 0 to 1."""
    low, high = (np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0 for colour in (at_none, at_all))
    red, green, blue = ((1.0 - share) * low + share * high).tolist()
    return red, green, blue


def before_faces(lines: pyvista.Actor, units: float) -> None:
    """Draw lines before the faces that they lie in."""
    lines.mapper.SetResolveCoincidentTopologyToPolygonOffset()
    lines.mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, units)


def near_part(bone: StoredBone, extent: np.ndarray) -> pyvista.PolyData | None:
    """What of a bone at rest lies near a body whose corners are ``extent`` (k, 3), in mm; None if nothing does."""
    import pyvista

    low, high = extent.min(axis=0) - BONES_AROUND_MM, extent.max(axis=0) + BONES_AROUND_MM
    surface = pyvista.PolyData.from_regular_faces(1e3 * bone.points, bone.triangles)
    if surface.n_open_edges:
        surface = surface.fill_holes(LARGEST_HOLE_MM).clean().compute_normals(auto_orient_normals=True)
        surface.clear_data()
    for normal, origin in [*((-axis, low) for axis in np.eye(3)), *((axis, high) for axis in np.eye(3))]:
        if surface.n_points and np.any((surface.points - origin) @ normal > 0.0):
            surface = cut_off(surface, normal, origin)
    return surface if surface.n_points else None


def cut_off(surface: pyvista.PolyData, normal: np.ndarray, origin: np.ndarray) -> pyvista.PolyData:
    """What lies behind a plane, seen against its normal; the cut of a closed surface is closed by a face."""
    if surface.n_points and surface.is_manifold:
        return surface.clip_closed_surface(normal=-normal, origin=origin)
    return surface.clip(normal=normal, origin=origin, invert=True)


def dashes(outline: np.ndarray, length: float) -> np.ndarray:
    """Ends (2 k, 3) of the straight pieces of dashes so long, of lines (n, 3) that rows of NaN part."""
    ends = []
    for line in np.split(outline, np.flatnonzero(np.isnan(outline[:, 0]))):
        line = line[np.isfinite(line[:, 0])]
        if len(line) < 2:
            continue
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        starts = np.arange(0.0, along[-1], length / DASH_SHARE)
        # A dash that goes round a corner is a piece before it and one after it.
        marks = np.unique(np.concatenate([along, starts, np.minimum(starts + length, along[-1])]))
        pieces = np.column_stack([marks[:-1], marks[1:]])
        at = pieces[pieces.mean(axis=1) % (length / DASH_SHARE) < length].ravel()
        ends.append(np.column_stack([np.interp(at, along, line[:, axis]) for axis in range(3)]))
    return np.concatenate(ends) if ends else np.zeros((0, 3))


def _segments(ends: np.ndarray) -> pyvista.PolyData:
    return _polylines(ends, [2] * (len(ends) // 2))


def _polylines(points: np.ndarray, lengths: Sequence[int]) -> pyvista.PolyData:
    """Lines of so many points each, one after the other."""
    import pyvista

    begin = np.cumsum([0, *lengths])[:-1]
    lines = np.concatenate([[count, *range(first, first + count)] for first, count in zip(begin, lengths, strict=True)])
    return pyvista.PolyData(points, lines=lines)
