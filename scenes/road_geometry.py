# Needs Python 3.11 and scenariogeneration==0.16.7. Used by roadkit.py.
"""Plan views of roads from lines, arcs and cubics. Metres, radians; a pose is x, y, heading."""

from __future__ import annotations

import math

from scenariogeneration import xodr


def ahead(point: tuple[float, float], heading: float, distance: float) -> tuple[float, float]:
    return point[0] + distance * math.cos(heading), point[1] + distance * math.sin(heading)


def wrapped(angle: float) -> float:
    return math.remainder(angle, 2 * math.pi)


def bend(center: tuple[float, float], radius: float, from_deg: float, to_deg: float) -> tuple:
    """Points of an arc for a street's way, at most 45 degrees apart; its ends as seen from the centre."""
    n = max(1, math.ceil(abs(to_deg - from_deg) / 45))
    angles = [math.radians(from_deg + (to_deg - from_deg) * k / n) for k in range(n + 1)]
    return tuple(ahead(center, angle, radius) for angle in angles)


class Plan:
    """A plan view that is built piece by piece, and its length and points."""

    def __init__(self) -> None:
        self.view = xodr.PlanView()
        self.length_m = 0.0
        self.points: list[tuple[float, float]] = []

    def line(self, x: float, y: float, heading: float, length: float) -> None:
        if length < 0.01:
            return
        self.view.add_fixed_geometry(xodr.Line(length), x, y, heading % (2 * math.pi))
        self._note([ahead((x, y), heading, length * k / 20) for k in range(21)], length)

    def arc(self, x: float, y: float, heading: float, radius: float, turn: float) -> None:
        length, sign = radius * abs(turn), math.copysign(1.0, turn)
        arc = xodr.Arc(sign / radius, length=length)
        self.view.add_fixed_geometry(arc, x, y, heading % (2 * math.pi))
        cx, cy = x - sign * radius * math.sin(heading), y + sign * radius * math.cos(heading)
        angles = [heading - sign * math.pi / 2 + turn * k / 20 for k in range(21)]
        self._note([(cx + radius * math.cos(a), cy + radius * math.sin(a)) for a in angles], length)

    def curve(self, a: tuple[float, float, float], b: tuple[float, float, float]) -> None:
        """A cubic from pose to pose, near to an arc where one fits."""
        dx, dy = b[0] - a[0], b[1] - a[1]
        chord, direction = math.hypot(dx, dy), math.atan2(dy, dx)
        bend = abs(wrapped(a[2] - direction)) + abs(wrapped(b[2] - direction))
        pull = chord * (2 * math.tan(bend / 4) / math.sin(bend / 2) if bend > 1e-3 else 1.0)
        cos, sin = math.cos(a[2]), math.sin(a[2])
        end = (dx * cos + dy * sin, dy * cos - dx * sin)
        turn = wrapped(b[2] - a[2])
        out = (pull * math.cos(turn), pull * math.sin(turn))
        start = (pull, 0.0)
        c = [3 * end[k] - 2 * start[k] - out[k] for k in (0, 1)]
        d = [start[k] + out[k] - 2 * end[k] for k in (0, 1)]

        def at(p: float) -> tuple[float, float]:
            u, v = (start[k] * p + c[k] * p * p + d[k] * p**3 for k in (0, 1))
            return a[0] + u * cos - v * sin, a[1] + u * sin + v * cos

        fine = [at(k / 400) for k in range(401)]
        length = sum(math.dist(p, q) for p, q in zip(fine, fine[1:]))
        poly = xodr.ParamPoly3(0, start[0], c[0], d[0], 0, start[1], c[1], d[1], "normalized", length)
        self.view.add_fixed_geometry(poly, a[0], a[1], a[2] % (2 * math.pi))
        self._note(fine[::10], length)

    def _note(self, points: list[tuple[float, float]], length: float) -> None:
        self.points.extend(points[1:] if self.points else points)
        self.length_m += length

    def least_radius_m(self, right_m: float) -> float:
        """Least radius of the line `right_m` to the right."""
        least = math.inf
        for p, q, r in zip(self.points, self.points[1:], self.points[2:]):
            turn = wrapped(math.atan2(r[1] - q[1], r[0] - q[0]) - math.atan2(q[1] - p[1], q[0] - p[0]))
            if abs(turn) > 1e-6:
                radius = (math.dist(p, q) + math.dist(q, r)) / 2 / abs(turn)
                least = min(least, radius + (right_m if turn > 0 else -right_m))
        return least


def turn_plan(a: tuple[float, float, float], b: tuple[float, float, float]) -> Plan:
    """Straight, arc, straight where the two tangents meet ahead; else one cubic."""
    plan = Plan()
    turn = wrapped(b[2] - a[2])
    if abs(turn) > math.radians(12):
        # a + u * direction(a) = b - v * direction(b)
        dx, dy = b[0] - a[0], b[1] - a[1]
        u = (dx * math.sin(b[2]) - dy * math.cos(b[2])) / math.sin(turn)
        v = (dy * math.cos(a[2]) - dx * math.sin(a[2])) / math.sin(turn)
        if u > 1.0 and v > 1.0:
            tangent = min(u, v)
            plan.line(*a, u - tangent)
            x, y = ahead(a[:2], a[2], u - tangent)
            plan.arc(x, y, a[2], tangent / math.tan(abs(turn) / 2), turn)
            x, y = ahead(b[:2], b[2], tangent - v)
            plan.line(x, y, b[2], v - tangent)
            return plan
    dx, dy = b[0] - a[0], b[1] - a[1]
    if abs(turn) < 1e-6 and abs(dy * math.cos(a[2]) - dx * math.sin(a[2])) < 1e-6:
        plan.line(*a, math.hypot(dx, dy))
    else:
        plan.curve(a, b)
    return plan
