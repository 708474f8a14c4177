# Needs Python 3.11 and scenariogeneration==0.16.7. Used by roadkit.py.
"""Crossings and the streets between them: cross-sections, arms, and which lane may go where."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from road_geometry import ahead, wrapped
from scenariogeneration import xodr

STRAIGHT_RAD = math.radians(30)  # smaller turns at a crossing count as straight on


@dataclass(frozen=True)
class Lane:
    """A lane of a cross-section; `mark` is the line on its outer edge."""

    kind: str
    width_m: float
    mark: str = "none"
    # Zero before both crossings, full in between: (first, last) share of the street; None: everywhere.
    bay: tuple[float, float] | None = None


def driving(n: int, width_m: float, edge: str = "curb") -> tuple[Lane, ...]:
    return tuple(Lane("driving", width_m, "broken" if k + 1 < n else edge) for k in range(n))


@dataclass(frozen=True)
class Profile:
    """A cross-section: lanes from the middle outwards on both sides."""

    right: tuple[Lane, ...]
    left: tuple[Lane, ...]
    speed_kmh: int
    centre: str = "broken"


@dataclass
class Crossing:
    """A point where streets meet, and how its corners and rules are made."""

    id: int
    x: float
    y: float
    z: float = 0.0
    kerb_radius_m: float = 6.0
    has_lights: bool = False
    has_crosswalks: bool = True
    # Innermost lane for left turns only, where three lanes or more arrive.
    has_turn_lanes: bool = True
    least_m: float = 5.0
    # Numbers of the streets that give way here.
    yields: frozenset[int] = frozenset()
    arms: list[Arm] = field(default_factory=list)


@dataclass
class Street:
    """A road from one crossing to another, through points on the way."""

    id: int
    start: int
    end: int
    profile: Profile
    via: tuple[tuple[float, float], ...] = ()
    name: str = ""
    # Headings away from the two crossings, degrees; None: towards the next point.
    start_deg: float | None = None
    end_deg: float | None = None
    road: xodr.Road | None = None
    length_m: float = 0.0


@dataclass
class Arm:
    """One end of a street, at its crossing; `heading` leads away from the crossing."""

    crossing: Crossing
    street: Street
    is_start: bool
    heading: float
    reach_m: float = 0.0

    @property
    def point(self) -> tuple[float, float]:
        return ahead((self.crossing.x, self.crossing.y), self.heading, self.reach_m)

    def lanes(self, inbound: bool) -> list[tuple[int, Lane, float]]:
        """Lane number, lane and inner offset, from the middle outwards; bays are closed here."""
        is_right = inbound != self.is_start
        lanes = self.street.profile.right if is_right else self.street.profile.left
        offset, result = 0.0, []
        for rank, lane in enumerate(lanes, start=1):
            result.append((-rank if is_right else rank, lane, offset))
            offset += 0.0 if lane.bay else lane.width_m
        return result

    def open(self, inbound: bool, kind: str) -> list[tuple[int, Lane, float]]:
        return [entry for entry in self.lanes(inbound) if entry[1].kind == kind]

    def kerb_m(self, inbound: bool) -> float:
        """From the street's line to the pavement, or to the outer edge where there is none."""
        walk = self.open(inbound, "sidewalk")
        if walk:
            return walk[0][2]
        return sum(0.0 if lane.bay else lane.width_m for _, lane, _ in self.lanes(inbound))

    def border(self, inbound: bool, offset: float) -> tuple[float, float, float]:
        """Pose on the street's end, `offset` to the right in the direction of travel."""
        heading = self.heading + math.pi if inbound else self.heading
        x, y = self.point
        return x + offset * math.sin(heading), y - offset * math.cos(heading), heading

    @property
    def contact(self) -> xodr.ContactPoint:
        return xodr.ContactPoint.start if self.is_start else xodr.ContactPoint.end


def lay_out(crossings: dict[int, Crossing], streets: list[Street]) -> None:
    """Finds the arms of each crossing and how far from its middle the streets end."""
    for street in streets:
        a, b = crossings[street.start], crossings[street.end]
        first = street.via[0] if street.via else (b.x, b.y)
        last = street.via[-1] if street.via else (a.x, a.y)
        for crossing, is_start, point, degrees in (
            (a, True, first, street.start_deg),
            (b, False, last, street.end_deg),
        ):
            heading = math.atan2(point[1] - crossing.y, point[0] - crossing.x)
            heading = heading if degrees is None else math.radians(degrees)
            crossing.arms.append(Arm(crossing, street, is_start, heading % (2 * math.pi)))
    for crossing in crossings.values():
        crossing.arms.sort(key=lambda arm: arm.heading)
        for arm in crossing.arms:
            arm.reach_m = crossing.least_m
        for arm, following in pairs_around(crossing):
            angle = (following.heading - arm.heading) % (2 * math.pi)
            if not math.radians(5) < angle < math.radians(160):
                continue
            here, there = arm.kerb_m(True), following.kerb_m(False)
            fillet = crossing.kerb_radius_m / math.tan(angle / 2)
            sin, cos = math.sin(angle), math.cos(angle)
            arm.reach_m = max(arm.reach_m, (here * cos + there) / sin + fillet)
            following.reach_m = max(following.reach_m, (here + there * cos) / sin + fillet)


def pairs_around(crossing: Crossing) -> list[tuple[Arm, Arm]]:
    """Each arm with the next one counter-clockwise, where a pavement leads round the corner."""
    arms = crossing.arms
    return [(arm, arms[(k + 1) % len(arms)]) for k, arm in enumerate(arms)]


def movements(arm: Arm) -> list[tuple[tuple, Arm, tuple, float]]:
    """Which lane may go where: (lane in, arm out, lane out, turn)."""
    arriving = arm.open(True, "driving")
    exits: dict[str, list[tuple[Arm, float]]] = {"left": [], "straight": [], "right": []}
    for other in arm.crossing.arms:
        # The end of a turning loop leads away from it.
        if other.street is not arm.street and other.open(False, "driving"):
            turn = wrapped(other.heading - arm.heading - math.pi)
            side = "straight" if abs(turn) < STRAIGHT_RAD else "left" if turn > 0 else "right"
            exits[side].append((other, turn))
    result = []
    n = len(arriving)
    keeps_left = arm.crossing.has_turn_lanes and n >= 3 and exits["left"] and exits["straight"]
    for other, turn in exits["straight"]:
        leaving = other.open(False, "driving")
        through = arriving[1:] if keeps_left else arriving
        # Outermost meets outermost; surplus lanes merge into the innermost.
        for k, lane in enumerate(reversed(through)):
            result.append((lane, other, leaving[max(len(leaving) - 1 - k, 0)], turn))
    for other, turn in exits["left"]:
        leaving = other.open(False, "driving")
        n_turning = 1 if exits["straight"] else max(1, n - 1 if exits["right"] else n)
        for k, lane in enumerate(arriving[: min(n_turning, len(leaving))]):
            result.append((lane, other, leaving[k], turn))
    for other, turn in exits["right"]:
        leaving = other.open(False, "driving")
        result.append((arriving[-1], other, leaving[-1], turn)) if arriving else None
    # A lane that is left without a way on turns with its neighbour.
    for k, lane in enumerate(arriving):
        if not any(entry[0][0] == lane[0] for entry in result):
            side = exits["left"] or exits["right"]
            other, turn = side[0]
            leaving = other.open(False, "driving")
            result.append((lane, other, leaving[min(k, len(leaving) - 1)], turn))
    return result


def phases(crossing: Crossing) -> list[list[Arm]]:
    """Arms that are green together: those that face each other."""
    groups: list[list[Arm]] = []
    for arm in crossing.arms:
        if not arm.open(True, "driving"):
            continue
        for group in groups:
            if abs(wrapped(group[0].heading - arm.heading - math.pi)) < math.radians(40) and len(group) < 2:
                group.append(arm)
                break
        else:
            groups.append([arm])
    return groups
