"""The craft in three dimensions: a shaded body, its nozzles, what they were told to do and what they did.

Models: perspective from a fixed point of the LVLH frame (radial up, along-track to the right), faces with one
light, hidden parts by painter's order. Whether something is hidden by the body is exact: the body is convex,
so a point outside it is in front of it just when it is on the outer side of a face that the eye sees.
Leaves out: shadows, and the order of nozzles that touch each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt
import pygame

from thruster_envs.rendering.canvas import (
    COMMANDED_EDGE,
    DELIVERED,
    FAILED,
    MUTED,
    PANEL,
    TEXT,
    Canvas,
    Color,
    blend,
)
from thruster_envs.rendering.layout import Box, Layout
from thruster_envs.rendering.model import (
    PLUME_SPREAD,
    Solids,
    SpacecraftModel,
    circle_across,
    rotation_from_quaternion,
)
from thruster_envs.rendering.scene import CraftScene

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Piece = tuple[float, Callable[[], None]]  # depth, how to draw it
Face = tuple[int, list[list[float]], Color]  # number, outline in pixels of the surface, colour

EYE = np.array([0.42, -0.52, -0.80]) / np.linalg.norm([0.42, -0.52, -0.80])  # direction in LVLH
EYE_DISTANCE = 5.5  # in radii of the sphere that holds the craft
LIGHT = np.array([0.80, -0.55, -0.42]) / np.linalg.norm([0.80, -0.55, -0.42])
AMBIENT = 0.30
FILLED_SHARE = 0.97  # of the panel, by the sphere that holds the craft

FRAME: Color = (150, 158, 178)
CELLS: Color = (36, 66, 130)
CELL_LINE: Color = (92, 130, 200)
STRUT: Color = (112, 122, 146)
NOZZLE: Color = (190, 194, 206)
NOZZLE_INSIDE: Color = (22, 25, 34)
BODY_AXES: tuple[Color, ...] = ((255, 190, 92), (112, 218, 150), (160, 158, 255))
LVLH_AXES: tuple[Color, ...] = ((104, 118, 146),) * 3
FAILED_PLUME: Color = (255, 96, 72)
SEEN_THROUGH: Color = (150, 44, 34)  # a failed thruster's plume where the body hides it
PLANETS: tuple[tuple[float, Color, Color], ...] = (
    (3.986e14, (70, 140, 230), (13, 26, 50)),  # the Earth
    (4.283e13, (226, 128, 84), (52, 25, 17)),  # Mars
)
"""Gravitational parameter, m^3/s^2, colour of the air, colour of what is below it."""

STARS = 110
STAR_SEED = 3

CELL_ROWS = 4  # solar cells along an edge of a face
FAINTEST_THRUST = 0.004
PLUME_PIECES = 16  # of a plume at full thrust
ARC_POINTS = 5
# Radius (as a share) and brightness of the nested cones of a plume, from the outside in.
PLUME_SHELLS = ((1.0, 0.08), (0.84, 0.17), (0.68, 0.29), (0.52, 0.45), (0.36, 0.68), (0.2, 1.0))
NARROW_PANEL = 250.0  # pixels: below, only the body axes are shown; below two thirds of that, none


@dataclass(frozen=True, kw_only=True)
class View:
    """A projection of the body frame onto the panel, for one attitude."""

    camera: FloatArray
    """(3, 3) from body to camera axes: right, up, towards the eye."""
    light: FloatArray
    """(3,) direction to the light in the body frame."""
    distance: float
    """m, of the eye from the centre of mass."""
    focal_length: float
    """Pixels."""
    centre: FloatArray
    """(2,) pixels, where the centre of mass comes to lie."""

    @property
    def eye(self) -> FloatArray:
        """(3,) m, the eye in the body frame."""
        eye: FloatArray = self.distance * self.camera[2]
        return eye

    def project(self, points: FloatArray) -> FloatArray:
        """(..., 2) pixels of (..., 3) m in the body frame."""
        seen = points @ self.camera.T
        flat = seen[..., :2] * (self.focal_length / (self.distance - seen[..., 2:]))
        flat[..., 1] *= -1.0
        flat += self.centre
        projected: FloatArray = flat
        return projected

    def depth(self, points: FloatArray) -> FloatArray:
        """(...,) m, distance from the eye along the line of sight."""
        depth: FloatArray = self.distance - points @ self.camera[2]
        return depth

    def scale(self, points: FloatArray) -> FloatArray:
        """(...,) pixels per m at (..., 3) m in the body frame."""
        scale: FloatArray = self.focal_length / self.depth(points)
        return scale

    def faces_eye(self, solids: Solids) -> BoolArray:
        """(solids, faces) which faces the eye sees."""
        seen: BoolArray = ((self.eye - solids.corners[:, :, 0]) * solids.normals).sum(axis=-1) > 0.0
        return seen

    def shade(self, normals: FloatArray) -> FloatArray:
        """(...,) brightness of faces with unit normals (..., 3), 0..1."""
        shade: FloatArray = AMBIENT + (1.0 - AMBIENT) * np.maximum(0.0, normals @ self.light)
        return shade


class CraftView:
    """Draws one craft into its box of the layout."""

    def __init__(self, canvas: Canvas, model: SpacecraftModel, layout: Layout) -> None:
        self._canvas = canvas
        self._model = model
        self._layout = layout
        left, top, width, height = layout.craft
        caption = layout.text_size + 12.0 * layout.scale
        self._box: Box = (left + 1, top + 1, width - 2, height - 2)
        self._centre = np.array([left + width / 2, top + caption + (height - caption) / 2])
        self._distance = EYE_DISTANCE * model.reach
        room = FILLED_SHARE * min(width, height - caption) / 2
        self._focal_length = room * math.sqrt(self._distance**2 - model.reach**2) / model.reach
        right = np.cross(-EYE, [1.0, 0.0, 0.0])
        right /= np.linalg.norm(right)
        self._camera_from_lvlh = np.stack([right, np.cross(EYE, right), EYE])
        circles = [circle_across(direction, 24) for direction in model.plume_directions]
        self._rims = [np.vstack([circle, circle[:1]]) for circle in circles]
        self._plume_colors = {
            (color, pieces): _plume_colors(color, pieces)
            for color in (DELIVERED, FAILED_PLUME, SEEN_THROUGH)
            for pieces in range(4, PLUME_PIECES + 1)
        }

    def draw_static(self) -> None:
        """What does not change: stars, and the limb of the planet where it is, below."""
        canvas = self._canvas
        _, air, ground = min(
            PLANETS, key=lambda planet: abs(math.log(planet[0] / self._model.gravitational_parameter))
        )
        left, top, width, height = self._box
        canvas.clip(self._box)
        size = max(1.0, self._layout.scale)
        places = np.random.default_rng(STAR_SEED).random((STARS, 3))
        for column, row, brightness in places.tolist():
            color = blend(PANEL, TEXT, 0.08 + 0.4 * brightness**3)
            canvas.circle(
                color, (left + column * width, top + row * height), (0.45 + 0.5 * brightness**4) * size
            )
        radius = 2.6 * max(width, height)
        centre = (left + 0.42 * width, top + 0.86 * height + radius)
        thickness = 0.16 * height
        for share in np.linspace(1.0, 0.0, 41).tolist():
            canvas.circle(blend(PANEL, air, 0.32 * (1.0 - share) ** 3), centre, radius + thickness * share)
        for share in np.linspace(0.0, 1.0, 25).tolist():
            canvas.circle(
                blend(blend(PANEL, air, 0.32), ground, share**0.4), centre, radius - 0.12 * height * share
            )
        canvas.clip(None)

    def draw(self, craft: CraftScene) -> None:
        """Draw the craft with its plumes, the marks of failed thrusters, numbers and axes."""
        body_from_lvlh = rotation_from_quaternion(craft.attitude)
        view = View(
            camera=self._camera_from_lvlh @ body_from_lvlh.T,
            light=body_from_lvlh @ LIGHT,
            distance=self._distance,
            focal_length=self._focal_length,
            centre=self._centre,
        )
        self._canvas.clip(self._box)
        behind, before = self._pieces(view, craft)
        for _, draw in sorted(behind, key=_depth_of, reverse=True):
            draw()
        self._draw_body(view)
        for _, draw in sorted(before, key=_depth_of, reverse=True):
            draw()
        self._draw_numbers(view, craft, self._draw_axes(view))
        self._canvas.clip(None)

    def _pieces(self, view: View, craft: CraftScene) -> tuple[list[Piece], list[Piece]]:
        """Everything outside the body: what is behind it, and what is in front."""
        model = self._model
        pieces: tuple[list[Piece], list[Piece]] = ([], [])

        thrust = craft.thrust.clip(0.0, 1.0)
        plumes = [FAILED_PLUME if failed else DELIVERED for failed in craft.faulty]
        insides = [
            blend(NOZZLE_INSIDE, plume, min(1.0, 3.0 * float(share)))
            for plume, share in zip(plumes, thrust, strict=True)
        ]
        cluster_faces = self._faces(view, model.clusters, [STRUT] * len(model.clusters.corners))
        nozzle_faces = self._faces(
            view, model.nozzles, [FAILED if failed else NOZZLE for failed in craft.faulty]
        )
        strut_middles = model.struts.mean(axis=1)
        ends_before = self._in_front(view, model.struts[:, 1]).tolist()
        for index, is_before in enumerate(ends_before):
            at = float(view.depth(strut_middles[index]))
            pieces[is_before].append((at, partial(self._draw_strut, view, model.struts[index])))
            at = float(view.depth(model.struts[index, 1]))
            pieces[is_before].append((at, partial(self._draw_faces, cluster_faces[index])))
        middles = (model.positions + model.exits) / 2
        depths = view.depth(middles).tolist()
        middles_before = self._in_front(view, middles).tolist()
        for index, is_before in enumerate(middles_before):
            draw = partial(self._draw_faces, nozzle_faces[index], insides[index])
            pieces[is_before].append((depths[index], draw))
            failed = bool(craft.faulty[index])
            for share, jet in (
                (float(craft.duties[index]), partial(self._draw_outline, view, failed, self._rims[index])),
                (float(thrust[index]), partial(self._draw_plume, view, plumes[index])),
            ):
                if share >= FAINTEST_THRUST:
                    self._add_jet(pieces, view, index, min(1.0, share), jet)
            if failed and thrust[index] >= FAINTEST_THRUST:
                stations, radii, in_front = self._cone(view, index, float(thrust[index]))
                hidden = partial(self._draw_plume, view, SEEN_THROUGH, stations, radii, ~in_front)
                pieces[True].append((-math.inf, hidden))
        return pieces

    def _add_jet(
        self,
        pieces: tuple[list[Piece], list[Piece]],
        view: View,
        index: int,
        share: float,
        draw: Callable[[FloatArray, FloatArray, BoolArray], None],
    ) -> None:
        """Add a cone of ``share`` of the full length, cut where it passes behind the body."""
        stations, radii, in_front = self._cone(view, index, share)
        for is_before in (False, True):
            drawn = in_front == is_before
            if drawn.any():
                middle = stations[1:][drawn].mean(axis=0)
                pieces[is_before].append((float(view.depth(middle)), partial(draw, stations, radii, drawn)))

    def _cone(self, view: View, index: int, share: float) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Stations along a plume, its radii there, and whether each piece of it is in front of the body."""
        model = self._model
        pieces = max(4, math.ceil(PLUME_PIECES * share))
        shares = share * np.arange(pieces + 1) / pieces
        stations = model.exits[index] + np.outer(shares * model.plume_length, model.plume_directions[index])
        radii = model.exit_radius * (1.0 + (PLUME_SPREAD - 1.0) * shares)
        return stations, radii, self._in_front(view, (stations[1:] + stations[:-1]) / 2)

    def _in_front(self, view: View, points: FloatArray) -> BoolArray:
        """(...,) whether points (..., 3) outside the body are in front of it."""
        corners, normals = self._model.box.corners[0], self._model.box.normals[0]
        offsets = (corners[:, 0] * normals).sum(axis=1)
        outside = points @ normals.T > offsets - 1e-9
        in_front: BoolArray = (outside & view.faces_eye(self._model.box)[0]).any(axis=-1)
        return in_front

    def _faces(self, view: View, solids: Solids, colors: list[Color]) -> list[list[Face]]:
        """For every solid the faces that the eye sees: number, outline in pixels of the surface, colour."""
        seen = np.argwhere(view.faces_eye(solids))
        chosen = (seen[:, 0], seen[:, 1])
        outlines = (view.project(solids.corners[chosen]) * self._canvas.factor).tolist()
        shades = view.shade(solids.normals[chosen]).tolist()
        faces: list[list[Face]] = [[] for _ in colors]
        for (solid, face), outline, shade in zip(seen.tolist(), outlines, shades, strict=True):
            faces[solid].append((face, outline, _lit(colors[solid], shade)))
        return faces

    def _draw_faces(self, faces: list[Face], exit_color: Color | None = None) -> None:
        """Draw the faces of one solid; of a nozzle the last one, its exit, in a colour of its own."""
        surface = self._canvas.surface
        for number, outline, color in faces:
            if exit_color is None or number < len(
                outline
            ):  # a nozzle has as many sides as its exit has corners
                pygame.draw.polygon(surface, color, outline)
            else:
                pygame.draw.polygon(surface, NOZZLE, outline)
                corners = np.array(outline)
                middle = corners.mean(axis=0)
                pygame.draw.polygon(surface, exit_color, (middle + 0.78 * (corners - middle)).tolist())

    def _draw_body(self, view: View) -> None:
        box = self._model.box
        shades = view.shade(box.normals[0])
        for face in np.flatnonzero(view.faces_eye(box)[0]).tolist():
            corners = box.corners[0, face]
            shade = float(shades[face])
            self._canvas.polygon(_lit(FRAME, shade), view.project(corners))
            middle = corners.mean(axis=0)
            inset = middle + 0.85 * (corners - middle)
            if face < 2:
                self._draw_port(view, inset, shade, is_open=face == 0)
            else:
                self._draw_cells(view, inset, shade)

    def _draw_port(self, view: View, inset: FloatArray, shade: float, *, is_open: bool) -> None:
        """A round port in place of solar cells: the x faces differ from the rest, and +x from -x."""
        middle = inset.mean(axis=0)
        across, along = (inset[0] - inset[1]) / 2, (inset[1] - inset[2]) / 2
        radius = 0.62 * min(float(np.linalg.norm(across)), float(np.linalg.norm(along)))
        circle = radius * circle_across(np.cross(across, along), 32)
        self._canvas.polygon(_lit(blend(FRAME, STRUT, 0.8), 0.9 * shade), view.project(inset))
        self._canvas.polygon(_lit(FRAME, min(1.0, 1.15 * shade)), view.project(middle + circle))
        self._canvas.polygon(
            _lit(NOZZLE_INSIDE if is_open else STRUT, shade), view.project(middle + 0.8 * circle)
        )

    def _draw_cells(self, view: View, inset: FloatArray, shade: float) -> None:
        self._canvas.polygon(_lit(CELLS, shade), view.project(inset))
        shares = np.arange(1, CELL_ROWS)[:, None] / CELL_ROWS
        color = blend(_lit(CELLS, shade), _lit(CELL_LINE, shade), 0.45)
        for first, second, third, fourth in ((0, 1, 3, 2), (1, 2, 0, 3)):
            starts = view.project(inset[first] + shares * (inset[second] - inset[first]))
            ends = view.project(inset[third] + shares * (inset[fourth] - inset[third]))
            for start, end in zip(starts, ends, strict=True):
                self._canvas.line(color, start, end, width=0.5)

    def _draw_strut(self, view: View, strut: FloatArray) -> None:
        (left, top), (right, bottom) = view.project(strut).tolist()
        half = 0.018 * self._model.size * float(view.scale(strut.mean(axis=0)))
        length = max(math.hypot(right - left, bottom - top), 1e-9)
        aside, down = half * (top - bottom) / length, half * (right - left) / length
        corners = [(left + aside, top + down), (right + aside, bottom + down)]
        corners += [(right - aside, bottom - down), (left - aside, top - down)]
        self._canvas.polygon(_lit(STRUT, 0.72), corners)

    def _draw_plume(
        self, view: View, color: Color, stations: FloatArray, radii: FloatArray, drawn: BoolArray
    ) -> None:
        """Add light: nested cones, each piece brighter the nearer to the nozzle it is."""
        surface, scratch, factor = self._canvas.surface, self._canvas.scratch, self._canvas.factor
        centres = view.project(stations) * factor
        spread = radii * view.scale(stations) * factor
        direction = stations[-1] - stations[0]
        sight = view.eye - stations[0]
        flatness = abs(float(direction @ sight)) / float(np.linalg.norm(direction) * np.linalg.norm(sight))
        margin = float(spread.max()) + 2.0
        low, high = centres.min(axis=0) - margin, centres.max(axis=0) + margin
        area = pygame.Rect(int(low[0]), int(low[1]), int(high[0] - low[0]) + 2, int(high[1] - low[1]) + 2)
        area = area.clip(surface.get_clip())
        scratch.fill((0, 0, 0), area)
        order = np.flatnonzero(drawn)[::-1].tolist()
        shares = np.array([share for share, _ in PLUME_SHELLS])
        outlines = _joined_discs(centres, shares[:, None] * spread, max(flatness, 0.03)).tolist()
        for shell, colors in zip(outlines, self._plume_colors[color, len(drawn)], strict=True):
            for piece in order:
                pygame.draw.polygon(scratch, colors[piece], shell[piece])
        surface.blit(scratch, area.topleft, area, pygame.BLEND_RGB_ADD)

    def _draw_outline(
        self,
        view: View,
        failed: bool,
        circle: FloatArray,
        stations: FloatArray,
        radii: FloatArray,
        drawn: BoolArray,
    ) -> None:
        """The cone that the plume would fill if the thruster delivered what was commanded."""
        color = blend(PANEL, FAILED if failed else COMMANDED_EDGE, 0.8 if failed else 0.5)
        centres = view.project(stations)
        spread = radii * view.scale(stations)
        right, down = (centres[-1] - centres[0]).tolist()
        across = np.array([-down, right]) / max(math.hypot(right, down), 1e-9)
        pieces = np.flatnonzero(drawn)
        first, last = int(pieces[0]), int(pieces[-1]) + 1
        for side in (-1.0, 1.0):
            edge = centres + side * spread[:, None] * across
            self._canvas.line(color, edge[first], edge[last], width=0.8)
        if drawn[-1]:
            self._canvas.lines(color, view.project(stations[-1] + radii[-1] * circle), width=0.8)

    def _draw_numbers(self, view: View, craft: CraftScene, taken: list[pygame.Rect]) -> None:
        """Rings and numbers of failed thrusters; numbers of the others that are seen and have room."""
        model, layout, canvas = self._model, self._layout, self._canvas
        middles = (model.positions + model.exits) / 2
        places = view.project(middles).tolist()
        hidden = self._behind_body(view, middles).tolist()
        depths = view.depth(middles).tolist()
        radii = (0.62 * np.linalg.norm(model.exits - model.positions, axis=1) * view.scale(middles)).tolist()
        obstacles = []  # numbers stand clear of these if they can
        for outline in view.project(model.nozzles.corners[:, -1]).tolist():
            columns, rows = [point[0] for point in outline], [point[1] for point in outline]
            obstacles.append(_rectangle(min(columns), min(rows), max(columns), max(rows)))
        for index in np.flatnonzero(craft.faulty).tolist():
            radius = radii[index] + 3.0 * layout.scale
            canvas.circle(FAILED, places[index], radius, width=2.0)
            column, row = places[index]
            obstacles.append(_rectangle(column - radius, row - radius, column + radius, row + radius))
        left, top, width, height = self._box
        bounds = _rectangle(left, top, left + width, top + height)
        for index in sorted(range(len(places)), key=lambda index: (not craft.faulty[index], depths[index])):
            failed, text = bool(craft.faulty[index]), str(index + 1)
            if hidden[index] and not failed:
                continue
            size = layout.text_size if failed else layout.small_size
            across = canvas.text_width(text, size) + (11 if failed else 2)
            down = round(0.72 * size) + (5 if failed else 1)
            clear = radii[index] + 0.55 * max(across, down) + 4.0 * layout.scale
            boxes = [
                box.clamp(bounds) for box in _around(places[index], view.centre.tolist(), clear, across, down)
            ]
            free = [box for box in boxes if box.collidelist(taken) < 0]
            if not free and not failed:
                continue
            box = next((box for box in free if box.collidelist(obstacles) < 0), (free or boxes)[0])
            taken.append(box)
            if failed:
                canvas.rectangle(FAILED, (box.x, box.y, box.width, box.height), radius=box.height / 2)
                canvas.text(PANEL, text, box.center, size)
            else:
                firing = craft.thrust[index] >= FAINTEST_THRUST
                canvas.text(TEXT if firing else MUTED, text, box.center, size)

    def _behind_body(self, view: View, points: FloatArray) -> BoolArray:
        """(n,) whether the body hides points (n, 3) outside it."""
        box = self._model.box
        covered = np.zeros(len(points), dtype=np.bool_)
        for face in view.project(box.corners[0, view.faces_eye(box)[0]]):
            edges = np.roll(face, -1, axis=0) - face
            sides = view.project(points)[:, None] - face
            turns = edges[:, 0] * sides[..., 1] - edges[:, 1] * sides[..., 0]
            covered |= (turns >= 0.0).all(axis=1) | (turns <= 0.0).all(axis=1)
        return covered & ~self._in_front(view, points)

    def _draw_axes(self, view: View) -> list[pygame.Rect]:
        """The body's axes at the lower left, those of the frame at the lower right; gives what they cover."""
        canvas, size = self._canvas, self._layout.small_size
        left, top, width, height = self._box
        length = 24.0 * max(0.75, self._layout.scale)
        inset = length + 0.9 * size
        corner = (left + inset + 2, top + height - inset)
        if width < NARROW_PANEL / 1.5:
            return []
        covered = [_rectangle(left, top + height - 2 * inset, left + 2 * inset, top + height)]
        self._draw_triad(corner, length, view.camera.T, ("x", "y", "z"), BODY_AXES)
        if width >= NARROW_PANEL:
            names = ("radial", "along", "cross")
            right = left + width - length - canvas.text_width(names[1], size) - 4
            row = top + height - 1.2 * size
            self._draw_triad((right, row), length, self._camera_from_lvlh.T, names, LVLH_AXES)
            edge = right - 0.5 * length - canvas.text_width(names[2], size) / 2
            covered.append(_rectangle(edge, row - length - 1.2 * size, left + width, top + height))
        return covered

    def _draw_triad(
        self,
        origin: tuple[float, float],
        length: float,
        directions: FloatArray,
        names: tuple[str, str, str],
        colors: tuple[Color, ...],
    ) -> None:
        """Three arrows along the rows of ``directions`` (camera axes), the nearest drawn last."""
        size = self._layout.small_size
        order = np.argsort(directions[:, 2]).tolist()
        tips = [(origin[0] + length * right, origin[1] - length * up) for right, up, _ in directions.tolist()]
        for axis in order:
            self._canvas.line(colors[axis], origin, tips[axis], width=1.6)
            self._canvas.circle(colors[axis], tips[axis], 0.09 * length)
        taken: list[pygame.Rect] = []
        for axis in reversed(order):
            right, up = directions[axis, :2].tolist()
            width = self._canvas.text_width(names[axis], size)
            distance = max(math.hypot(right, up), 1e-9)
            column, row = (
                tips[axis][0] + 0.6 * size * right / distance,
                tips[axis][1] - 0.6 * size * up / distance,
            )
            if len(names[axis]) > 1 and right > 0.4:  # a word is set beside an arrow to the right
                column, row = tips[axis][0] + 6.0 + width / 2, tips[axis][1]
            elif len(names[axis]) > 1 and right < -0.4:  # and below one to the left
                column, row = tips[axis][0] - 2.0, tips[axis][1] + 0.75 * size
            place = _rectangle(column - width / 2, row - 0.3 * size, column + width / 2, row + 0.3 * size)
            if place.collidelist(taken) < 0:
                taken.append(place)
                self._canvas.text(colors[axis], names[axis], (column, row), size)


def _depth_of(piece: Piece) -> float:
    return piece[0]


def _lit(color: Color, shade: float) -> Color:
    return blend((0, 0, 0), color, shade)


def _plume_colors(color: Color, pieces: int) -> list[list[Color]]:
    """Colours of the pieces of a plume from the nozzle on, shell by shell: whiter inside, fading to black."""
    fading = [(1.0 - (piece + 0.5) / pieces) ** 1.25 for piece in range(pieces)]
    return [
        [_lit(blend(color, (255, 255, 255), 0.75 * brightness**2), brightness * share) for share in fading]
        for _, brightness in PLUME_SHELLS
    ]


def _rectangle(left: float, top: float, right: float, bottom: float) -> pygame.Rect:
    return pygame.Rect(round(left), round(top), round(right - left), round(bottom - top))


def _around(
    place: list[float], centre: list[float], clear: float, across: float, down: float
) -> list[pygame.Rect]:
    """Boxes at a distance from ``place``, the first on the side away from ``centre``."""
    start = math.atan2(place[1] - centre[1], place[0] - centre[0])
    boxes = []
    for turn in (0.0, 0.5, -0.5, 1.0, -1.0, 1.6, -1.6, 2.3, -2.3, math.pi):
        column = place[0] + clear * math.cos(start + turn)
        row = place[1] + clear * math.sin(start + turn)
        boxes.append(_rectangle(column - across / 2, row - down / 2, column + across / 2, row + down / 2))
    return boxes


def _joined_discs(centres: FloatArray, radii: FloatArray, flatness: float) -> FloatArray:
    """(s, k, 2 * ARC_POINTS, 2) outlines that hold each pair of successive discs, as they are seen.

    ``centres`` (k + 1, 2) lie on a line; ``radii`` (s, k + 1); the discs stand across the line and are seen
    with the share ``flatness`` of their width. Along the line everything is divided by that, so that the
    discs become circles: their common outer tangents touch both at the angle acos((r0 - r1) / d) from the
    line between the centres, and where one circle holds the other the arc of the larger closes.
    """
    heading = centres[-1] - centres[0]
    distance = math.hypot(float(heading[0]), float(heading[1]))
    axis = heading / distance if distance > 1e-9 else np.array([1.0, 0.0])
    along = ((centres - centres[0]) @ axis) / flatness
    length = np.maximum(along[1:] - along[:-1], 1e-9)
    opening = np.arccos(np.clip((radii[:, :-1] - radii[:, 1:]) / length, -1.0, 1.0))[..., None]
    sweep = np.linspace(-1.0, 1.0, ARC_POINTS)
    far, near = opening * sweep, np.pi + (np.pi - opening) * sweep
    ahead = np.concatenate(
        [
            along[1:, None] + radii[:, 1:, None] * np.cos(far),
            along[:-1, None] + radii[:, :-1, None] * np.cos(near),
        ],
        axis=-1,
    )
    aside = np.concatenate([radii[:, 1:, None] * np.sin(far), radii[:, :-1, None] * np.sin(near)], axis=-1)
    outlines: FloatArray = (
        centres[0] + (ahead * flatness)[..., None] * axis + aside[..., None] * np.array([-axis[1], axis[0]])
    )
    return outlines
