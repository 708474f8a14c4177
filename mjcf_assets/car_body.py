"""A car's body as one skin over cross-sections: glass, lamps and wheel arches lie in it.

Frame: x forward from the middle of the length, y left, z up from the ground. Metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from model_writer import Model
from solids import Solid, box, extrude_x, extrude_y, loft, moved, wheel

# Rows of a cross-section, from the hidden edge beneath to the middle of the roof.
INNER, EDGE, DOOR_LOW, DOOR_MID, CREASE, BELT, RAIL, ROOF, CROWN, MIDDLE = range(10)
LONGEST_STEP_M = 0.45
DOOR_OPEN_RAD = math.radians(38)


@dataclass
class Body:
    """Side view and plan of a car. Lists of (x, z) run from the front to the back."""

    top: list[tuple[float, float]]  # along the middle: bonnet, windscreen, roof, tail
    belt: list[tuple[float, float]]  # lower edge of the side windows
    width: float
    axles: tuple[float, ...]
    wheel_radius: float
    windscreen: tuple[float, float]  # x at its foot and its head
    panes: list[tuple[float, float]]  # of the side windows, x from and to
    rear_glass: tuple[float, float] | None = None
    sill: float = 0.21
    roof_y: float = 0.62  # half the width of the roof
    arch_gap: float = 0.055
    cladding: bool = False  # black along sills and arches
    black_pillars: bool = True
    cover: tuple[float, float] | None = None  # black from x to x on top: a load bed's cover
    nose_taper: float = 0.13
    tail_taper: float = 0.09
    rail_drop: float = 0.10  # from the roof to the window's upper edge
    lamp_length: tuple[float, float] = (0.30, 0.22)  # of headlamps and taillamps along the flanks
    door: tuple[float, float] | None = None  # the left door that is left out, x from front to back
    stations: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        radius = self.arch_radius
        xs = [x for x, _ in self.top] + [x for pane in self.panes for x in pane] + list(self.door or ())
        for axle in self.axles:
            around = [-1.05, -1.0, -0.9, -0.66, -0.25, 0.25, 0.66, 0.9, 1.0, 1.05]
            xs += [axle + radius * share for share in around]
        for end, sense in ((self.front, -1), (self.back, 1)):
            xs += [end + sense * d for d in (0.035, 0.12, self.lamp_length[end < 0])]
        must = {round(x, 4) for pane in self.panes for x in pane} | {round(x, 4) for x, _ in self.top}
        kept: list[float] = []
        for x in sorted(xs):
            if kept and x - kept[-1] < 0.022:
                if round(x, 4) in must and kept[-1] not in must:
                    kept[-1] = round(x, 4)
                continue
            while kept and x - kept[-1] > LONGEST_STEP_M:
                kept.append(kept[-1] + (x - kept[-1]) / math.ceil((x - kept[-1]) / LONGEST_STEP_M))
            kept.append(round(x, 4))
        self.stations = np.array(kept)

    @property
    def front(self) -> float:
        return self.top[0][0]

    @property
    def back(self) -> float:
        return self.top[-1][0]

    @property
    def arch_radius(self) -> float:
        return self.wheel_radius + self.arch_gap

    def top_at(self, x: float) -> float:
        return float(np.interp(-x, [-p[0] for p in self.top], [p[1] for p in self.top]))

    def half_width_at(self, x: float) -> float:
        half = self.width / 2
        for end, taper, reach in ((self.front, self.nose_taper, 1.1), (self.back, self.tail_taper, 0.9)):
            d = abs(end - x)
            half -= self.width / 2 * taper * max(0.0, 1 - d / reach) ** 2.5
            half -= 0.075 * max(0.0, 1 - d / 0.12) ** 2
        return half

    def low_at(self, x: float) -> float:
        """The lower edge: sill, wheel arches, and rising bumpers."""
        low = self.sill
        for axle in self.axles:
            d = abs(x - axle) / self.arch_radius
            if d < 1.001:
                low = max(low, self.wheel_radius + self.arch_radius * math.sqrt(max(0.0, 1 - d * d)))
        ends = min(self.front - x, x - self.back)
        return max(low, self.sill + 0.07 * max(0.0, 1 - ends / 0.4) ** 2)

    def section(self, x: float) -> np.ndarray:
        """Rows [row, (y, z)] of the left half."""
        top, low, half = self.top_at(x), self.low_at(x), self.half_width_at(x)
        belt = float(np.interp(-x, [-p[0] for p in self.belt], [p[1] for p in self.belt]))
        highest = max(z for _, z in self.top)
        share = min(1.0, max(0.0, (top - belt - 0.05) / (highest - belt - 0.05)))
        belt = min(belt, top - 0.05)
        mix = lambda a, b: a + (b - a) * share  # noqa: E731
        in_arch = low > self.sill + 0.09
        rise = belt - low
        return np.array(
            [
                (half - 0.30, low),
                (half - (0.008 if in_arch else 0.05), low),
                (half - (0.004 if in_arch else 0.012), low + 0.30 * rise),
                (half, low + 0.60 * rise),
                (half - 0.022, belt - 0.16 * rise * min(1.0, 0.5 / max(rise, 0.1))),
                (half - 0.065, belt),
                (
                    mix(half - 0.13, self.roof_y + 0.045),
                    mix(belt + 0.55 * (top - belt), top - self.rail_drop),
                ),
                (mix(half - 0.22, self.roof_y - 0.03), top - mix(0.014, 0.032)),
                (mix(half - 0.22, self.roof_y - 0.03) * 0.55, top - 0.006),
                (0.0, top),
            ]
        )

    def material(self, x: float, row: int) -> str:
        """Of the quad above a row at x."""
        within = lambda span: span is not None and min(span) < x < max(span)  # noqa: E731
        if row == INNER:
            return "trim"
        if row == EDGE:
            return "trim" if self.cladding else "paint"
        if row == DOOR_MID:
            nose, tail = self.lamp_length
            if x > self.front - nose:
                return "headlamp"
            return "taillamp" if x < self.back + tail else "paint"
        if row == BELT:
            if any(within(pane) for pane in self.panes):
                return "glass"
            between = self.panes and min(map(min, self.panes)) < x < max(map(max, self.panes))
            return "trim" if between and self.black_pillars else "paint"
        if row >= ROOF and within(self.cover):
            return "trim"
        return "glass" if row >= ROOF and (within(self.windscreen) or within(self.rear_glass)) else "paint"

    def in_door(self, x: float, row: int, side: int) -> bool:
        is_along = self.door is not None and min(self.door) < x < max(self.door)
        return is_along and side > 0 and EDGE <= row <= BELT

    def build(self, model: Model) -> None:
        """Adds skin, wheels and what fills the inside, and the shapes that stand for them in collisions."""
        xs = self.stations
        half = np.array([self.section(x) for x in xs])
        for side in (1, -1):
            points = np.concatenate([np.tile(xs[:, None, None], (1, 10, 1)), half * [side, 1]], axis=2)
            quads: dict[str, list] = {}
            leaf: dict[str, list] = {}
            for i in range(len(xs) - 1):
                for row in range(MIDDLE):
                    x = (xs[i] + xs[i + 1]) / 2
                    into = leaf if self.in_door(x, row, side) else quads
                    into.setdefault(self.material(x, row), []).append((i, row))
            for material, cells in quads.items():
                model.add(material, skin(points, cells, side))
            if leaf:
                self.hang_door(model, points, leaf)
        for i, sense in ((0, -1), (len(xs) - 1, 1)):
            model.add("paint", end_cap(xs[i], half[i], sense))
        track = self.width / 2 - 0.125
        for x in self.axles:
            for y in (track, -track):
                tyre, rim = wheel(x, y, self.wheel_radius, 0.20, n=14)
                model.add("tyre", tyre)
                model.add("rim", rim)
        self.fill(model)
        self.collide(model, half)

    def fill(self, model: Model) -> None:
        """Black behind the wheels and, with a door open, in the cabin."""
        front, back = self.front - 0.35, self.back + 0.35
        high = min(self.top_at(front), self.top_at(back), 0.85) - 0.1
        inner = self.width - 0.60
        model.add("trim", box(((front + back) / 2, 0, (0.2 + high) / 2), (front - back, inner, high - 0.2)))
        if self.door:
            ahead, behind = max(self.door) + 0.1, min(self.door) - 0.1
            middle, length, head = (ahead + behind) / 2, ahead - behind, min(self.windscreen)
            under = lambda x: (x, self.top_at(x) - 0.075)  # noqa: E731
            cabin = [(ahead, 0.3), under(ahead), under(head), under(behind), (behind, 0.3)]
            model.add("trim", extrude_y(cabin, -0.5, 0.42))
            model.add("trim", box((middle, self.width / 4, 0.27), (length, self.width / 2 - 0.1, 0.10)))
            pillar = min(self.door) - 0.03
            across = [(y - 0.015, z) for y, z in self.section(pillar)[EDGE : ROOF + 1]]
            across += [(0.3, across[-1][1]), (0.3, across[0][1])]
            model.add("trim", extrude_x(across, pillar - 0.03, pillar + 0.02))
            seat = self.width / 2 - 0.38
            model.add("seat", box((middle - 0.15, seat, 0.46), (0.5, 0.44, 0.26)))
            back_rest = loft(
                [
                    [(-0.08, y, 0), (0.08, y, 0), (0.05, y * 0.8, 0.72), (-0.07, y * 0.8, 0.72)]
                    for y in (-0.22, 0.22)
                ]
            )
            model.add("seat", moved(back_rest, (middle - 0.36, seat, 0.50), pitch=-0.3))

    def hang_door(self, model: Model, points: np.ndarray, leaf: dict[str, list]) -> None:
        """The left front door, turned open about its front edge."""
        hinge = np.array([max(self.door), self.half_width_at(max(self.door)) - 0.02, 0.0])
        turn = lambda s: moved((s[0] - hinge, s[1]), hinge, yaw=-DOOR_OPEN_RAD)  # noqa: E731
        within = points * 1.0
        within[:, :, 1] -= 0.06
        for material, cells in leaf.items():
            model.add(material, turn(skin(points, cells, 1)))
            model.add("glass" if material == "glass" else "trim", turn(skin(within, cells, -1)))
        cells = [cell for group in leaf.values() for cell in group]
        columns = sorted({i for i, _ in cells})
        for i, way in ((columns[0], 1), (columns[-1] + 1, -1)):
            ring = np.stack([points[i, EDGE : RAIL + 1], within[i, EDGE : RAIL + 1]])
            model.add("trim", turn(skin(ring, [(0, row) for row in range(RAIL - EDGE)], way)))
        model.collide_hull(turn(skin(points, cells, 1)), turn(skin(within, cells, -1)))

    def collide(self, model: Model, half: np.ndarray) -> None:
        xs = self.stations
        below = [(x, s * y, z) for x, rows in zip(xs, half) for y, z in rows[: BELT + 1] for s in (1, -1)]
        bonnet = max(z for x, z in self.belt)
        cabin = [
            (x, s * y, z)
            for x, rows in zip(xs, half)
            if rows[MIDDLE, 1] > bonnet + 0.08
            for y, z in rows[BELT:]
            for s in (1, -1)
        ]
        none = np.zeros((0, 3), int)
        model.collide_hull((np.array(below), none), *model.parts["tyre"])
        model.collide_hull((np.array(cabin), none))


def skin(points: np.ndarray, cells: list, side: int) -> Solid:
    """The quads (station, row) of a grid of points [station, row, 3]; `side` is 1 where +y is outside."""
    n = points.shape[1]
    faces = []
    for i, row in cells:
        a, b, c, d = i * n + row, (i + 1) * n + row, (i + 1) * n + row + 1, i * n + row + 1
        faces += [(a, c, b), (a, d, c)] if side > 0 else [(a, b, c), (a, c, d)]
    f = np.array(faces)
    used, f = np.unique(f, return_inverse=True)
    return points.reshape(-1, 3)[used], f.reshape(-1, 3)


def end_cap(x: float, rows: np.ndarray, sense: int) -> Solid:
    """The flat end of the nose (sense 1) or tail (-1)."""
    rows = rows[EDGE:]
    v = np.array([(x, s * y, z) for y, z in rows for s in (1, -1)])
    f = []
    for k in range(len(rows) - 1):
        a, b, c, d = 2 * k, 2 * k + 1, 2 * k + 3, 2 * k + 2
        f += [(a, d, c), (a, c, b)] if sense > 0 else [(a, b, c), (a, c, d)]
    return v, np.array(f)


def fittings(
    model: Model,
    body: Body,
    grille: tuple[float, float, float] = (0.50, 0.9, 0.12),
    intake: tuple[float, float] = (0.34, 0.10),
    lamp_z: tuple[float, float] = (0.62, 0.78),
    lamp_size: tuple[float, float] = (0.22, 0.11),
    mirror: tuple[float, float, float] | None = None,
    rear_plate_z: float = 0.60,
) -> None:
    """Grille (z, width, height), lamps' faces, plates, bumpers, mirrors (x, z, height) and handles."""
    front, back = body.front, body.back
    z, width, height = grille
    y_front, y_back = body.half_width_at(front), body.half_width_at(back)
    model.add("trim", box((front, 0, z), (0.03, width, height)))
    model.add("trim", box((front, 0, intake[0]), (0.04, 1.5 * y_front, intake[1])))
    model.add("trim", box((back, 0, 0.36), (0.04, 1.55 * y_back, 0.12)))
    w, h = lamp_size
    for side in (1, -1):
        model.add("headlamp", box((front - 0.005, side * (y_front - w / 2 - 0.03), lamp_z[0]), (0.03, w, h)))
        model.add("taillamp", box((back + 0.005, side * (y_back - w / 2 - 0.03), lamp_z[1]), (0.03, w, h)))
        if mirror and not (body.door and side > 0):
            x, at, tall = mirror
            y = body.half_width_at(x)
            shape = [
                [(x - 0.05, a, at - tall / 2), (x + 0.07, a, at - tall * 0.3), (x - 0.05, a, at + tall / 2)]
                for a in (side * (y - 0.03), side * (y + 0.13))
            ]
            model.add("mirror", loft(shape))
        for _, x in body.panes[:2]:
            if body.door and side > 0 and min(body.door) < x + 0.1 < max(body.door):
                continue
            at = (x + 0.10, side * body.half_width_at(x), body.belt[0][1] - 0.16)
            model.add("trim", box(at, (0.17, 0.03, 0.03)))
    model.add("plate", box((front + 0.015, 0, z - height / 2 - 0.06 if z > 0.5 else z), (0.02, 0.52, 0.11)))
    model.add("plate", box((back - 0.008, 0, rear_plate_z), (0.02, 0.52, 0.11)))
