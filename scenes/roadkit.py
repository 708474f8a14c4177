# Needs Python 3.11 and scenariogeneration==0.16.7. Used by each town's make_road.py.
"""Road networks from crossings and streets: geometry, lanes, links, heights, crosswalks and signals.

A town is a list of `Crossing`s (a point, a height) and of `Street`s between them (a cross-section,
points on the way). `write_town` draws the rest: each street ends where the kerbs of its crossing
begin to turn; inside a crossing every permitted movement is a connecting road of one lane, an arc
with straight ends, and every pavement round a corner a road of its own. So lanes meet with equal
place, width and heading.

Heights: a crossing is flat; a street climbs from one to the other by one cubic with level ends.
Metres, radians; right-hand traffic. No randomness: same town, same file.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

from scenariogeneration import xodr

SMALLEST_RADIUS_M = 5.5  # of a lane's middle
TAPER_M = 4.0
STRAIGHT_RAD = math.radians(30)  # smaller turns at a crossing count as straight on
LATERAL_MPS2 = 2.5  # what a turn's speed limit allows sideways


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


def ahead(point: tuple[float, float], heading: float, distance: float) -> tuple[float, float]:
    return point[0] + distance * math.cos(heading), point[1] + distance * math.sin(heading)


def wrapped(angle: float) -> float:
    return math.remainder(angle, 2 * math.pi)


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


def road_mark(kind: str) -> xodr.RoadMark:
    if kind == "broken":
        return xodr.RoadMark(xodr.RoadMarkType.broken, width=0.12, length=3, space=4.5)
    if kind == "solid":
        return xodr.RoadMark(xodr.RoadMarkType.solid, width=0.12)
    if kind == "curb":
        return xodr.RoadMark(xodr.RoadMarkType.curb, width=0.15)
    return xodr.RoadMark(xodr.RoadMarkType.none)


def lane_element(lane: Lane, length_m: float) -> xodr.Lane:
    kind = getattr(xodr.LaneType, lane.kind)
    if lane.bay is None:
        element = xodr.Lane(kind, a=lane.width_m)
    else:
        c, d = 3 * lane.width_m / TAPER_M**2, 2 * lane.width_m / TAPER_M**3
        begin, end = (share * length_m for share in lane.bay)
        element = xodr.Lane(kind, a=0.0)
        element.add_lane_width(a=0.0, c=c, d=-d, soffset=begin)
        element.add_lane_width(a=lane.width_m, soffset=begin + TAPER_M)
        element.add_lane_width(a=lane.width_m, c=-c, d=d, soffset=end - TAPER_M)
        element.add_lane_width(a=0.0, soffset=end)
    element.add_roadmark(road_mark(lane.mark))
    return element


def changing_lane(kind: str, from_m: float, to_m: float, length_m: float) -> xodr.Lane:
    c, d = 3 * (to_m - from_m) / length_m**2, -2 * (to_m - from_m) / length_m**3
    element = xodr.Lane(getattr(xodr.LaneType, kind), a=from_m, c=c, d=d)
    element.add_roadmark(road_mark("none"))
    return element


def section(centre: str, right: list[xodr.Lane], left: list[xodr.Lane]) -> xodr.Lanes:
    middle = xodr.Lane(xodr.LaneType.none)
    middle.add_roadmark(road_mark(centre))
    result = xodr.LaneSection(0, middle)
    for lane in right:
        result.add_right_lane(lane)
    for lane in left:
        result.add_left_lane(lane)
    lanes = xodr.Lanes()
    lanes.add_lanesection(result)
    return lanes


def set_speed(road: xodr.Road, kmh: int) -> None:
    road.add_type(xodr.RoadType.town, speed=kmh, speed_unit="km/h")


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


def draw_street(street: Street, crossings: dict[int, Crossing]) -> None:
    a = next(arm for arm in crossings[street.start].arms if arm.street is street and arm.is_start)
    b = next(arm for arm in crossings[street.end].arms if arm.street is street and not arm.is_start)
    poses = [(*a.point, a.heading)]
    points = [a.point, *street.via, b.point]
    for before, here, after in zip(points, points[1:], points[2:]):
        # Catmull and Rom's tangent, weighted so that the nearer neighbour counts more.
        one, two = math.dist(before, here), math.dist(here, after)
        dx = (here[0] - before[0]) / one * two + (after[0] - here[0]) / two * one
        dy = (here[1] - before[1]) / one * two + (after[1] - here[1]) / two * one
        poses.append((*here, math.atan2(dy, dx)))
    poses.append((*b.point, b.heading + math.pi))
    plan = Plan()
    for one, two in zip(poses, poses[1:]):
        direction = math.atan2(two[1] - one[1], two[0] - one[0])
        is_straight = max(abs(wrapped(one[2] - direction)), abs(wrapped(two[2] - direction))) < 1e-9
        if is_straight:
            plan.line(*one, math.dist(one[:2], two[:2]))
        else:
            plan.curve(one, two)
    street.length_m = plan.length_m
    sides = [[lane_element(lane, plan.length_m) for lane in side]
             for side in (street.profile.right, street.profile.left)]  # fmt: skip
    road = xodr.Road(street.id, plan.view, section(street.profile.centre, *sides), name=street.name)
    set_speed(road, street.profile.speed_kmh)
    low, high = crossings[street.start].z, crossings[street.end].z
    rise, length = high - low, plan.length_m
    road.add_elevation(0, low, 0, 3 * rise / length**2, -2 * rise / length**3)
    grade, radius = 1.5 * abs(rise) / length, plan.least_radius_m(0.0)
    if grade > 0.08 or radius < 14.0 or length < 14.0:
        print(f"street {street.id}: length {length:.1f} m, grade {grade:.3f}, radius {radius:.1f} m")
    for arm in (a, b):
        link = road.add_predecessor if arm.is_start else road.add_successor
        link(xodr.ElementType.junction, arm.crossing.id)
        if arm.crossing.has_crosswalks:
            add_crosswalk(road, arm, plan.length_m)
    street.road = road


def add_crosswalk(road: xodr.Road, arm: Arm, length_m: float) -> None:
    """Across the carriageway from kerb to kerb, 1 to 4 m from the street's end."""
    if not (arm.open(True, "sidewalk") and arm.open(False, "sidewalk")):
        return
    # t is positive on the left of the road's line.
    right, left = (arm.kerb_m(inbound=not arm.is_start), arm.kerb_m(inbound=arm.is_start))
    middle, half = (left - right) / 2, (left + right) / 2
    s = 2.5 if arm.is_start else length_m - 2.5
    number = f"{arm.street.id}{0 if arm.is_start else 1}"
    walk = xodr.Object(
        s, middle, xodr.ObjectType.crosswalk,
        id=number, name="crosswalk", length=3.0, width=2 * half, height=0.0,
    )  # fmt: skip
    outline = xodr.Outline(closed=True, id=0)
    for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        outline.add_corner(xodr.CornerLocal(u * 1.5, v * half, 0, 0))
    walk.add_outline(outline)
    road.add_object(walk)


def movements(arm: Arm) -> list[tuple[tuple, Arm, tuple, float]]:
    """Which lane may go where: (lane in, arm out, lane out, turn)."""
    arriving = arm.open(True, "driving")
    exits: dict[str, list[tuple[Arm, float]]] = {"left": [], "straight": [], "right": []}
    for other in arm.crossing.arms:
        if other is not arm and other.open(False, "driving"):
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


def connect(junction, crossing, road_id, arm, other, plan, lanes, links, kmh, name) -> xodr.Road:
    road = xodr.Road(road_id, plan.view, section("none", lanes, []), road_type=crossing.id, name=name)
    set_speed(road, kmh)
    road.add_elevation(0, crossing.z, 0, 0, 0)
    road.add_predecessor(xodr.ElementType.road, arm.street.id, arm.contact)
    road.add_successor(xodr.ElementType.road, other.street.id, other.contact)
    connection = xodr.Connection(arm.street.id, road_id, xodr.ContactPoint.start)
    for rank, (lane, (lane_in, lane_out)) in enumerate(zip(lanes, links), start=1):
        lane.add_link("predecessor", lane_in)
        lane.add_link("successor", lane_out)
        connection.add_lanelink(lane_in, -rank)
    junction.add_connection(connection)
    return road


def draw_crossing(crossing: Crossing) -> tuple[xodr.Junction, list[xodr.Road]]:
    junction = xodr.Junction(f"crossing {crossing.id}", crossing.id)
    roads: list[xodr.Road] = []
    for arm in crossing.arms:
        for lane_in, other, lane_out, turn in movements(arm):
            plan = turn_plan(arm.border(True, lane_in[2]), other.border(False, lane_out[2]))
            widths = lane_in[1].width_m, lane_out[1].width_m
            radius = plan.least_radius_m(sum(widths) / 4)
            if radius < SMALLEST_RADIUS_M:
                print(f"crossing {crossing.id}: a turn of radius {radius:.2f} m")
            kmh = min(arm.street.profile.speed_kmh, int(3.6 * math.sqrt(LATERAL_MPS2 * min(radius, 400.0))))
            lane = changing_lane("driving", *widths, plan.length_m)
            side = "on" if abs(turn) < STRAIGHT_RAD else "left" if turn > 0 else "right"
            roads.append(connect(
                junction, crossing, crossing.id * 100 + len(roads), arm, other, plan,
                [lane], [(lane_in[0], lane_out[0])], max(kmh, 10), side,
            ))  # fmt: skip
    for arm, other in pairs_around(crossing):
        walks = arm.open(True, "sidewalk"), other.open(False, "sidewalk")
        if arm is other or not all(walks):
            continue
        (in_id, in_lane, in_m), (out_id, out_lane, out_m) = walks[0][0], walks[1][0]
        plan = turn_plan(arm.border(True, in_m), other.border(False, out_m))
        lane = changing_lane("sidewalk", in_lane.width_m, out_lane.width_m, plan.length_m)
        roads.append(connect(
            junction, crossing, crossing.id * 100 + len(roads), arm, other, plan,
            [lane], [(in_id, out_id)], 10, "pavement",
        ))  # fmt: skip
    return junction, roads


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


def add_light(road: xodr.Road, signal_id: int, length_m: float, ends_here: bool, t: float,
              lanes: tuple[int, int]) -> None:  # fmt: skip
    """A traffic light at a street's end: its stop line's s, beside the lanes at `t`."""
    light = xodr.Signal(
        s=length_m - 0.5 if ends_here else 0.5,
        t=t,
        country="OpenDRIVE",
        Type="1000001",
        id=str(signal_id),
        name=f"light {signal_id}",
        dynamic=xodr.Dynamic.yes,
        zOffset=2.4,
        orientation=xodr.Orientation.positive if ends_here else xodr.Orientation.negative,
        height=0.9,
        width=0.35,
    )
    light.add_validity(*lanes)
    road.add_signal(light)


def add_lights(crossing: Crossing) -> list[tuple[int, list[int]]]:
    """Lights on every approach; controllers with the signals that are green together."""
    controllers = []
    for k, group in enumerate(phases(crossing)):
        signals = []
        for arm in group:
            street, lanes = arm.street, [entry[0] for entry in arm.open(True, "driving")]
            signal_id = crossing.id * 1000 + crossing.arms.index(arm)
            beside = arm.kerb_m(inbound=True) + 0.6
            t = beside if arm.is_start else -beside
            add_light(street.road, signal_id, street.length_m, not arm.is_start, t, (min(lanes), max(lanes)))
            signals.append(signal_id)
        controllers.append((crossing.id * 1000 + 500 + k, signals))
    return controllers


def add_speed_sign(street: Street) -> None:
    """German sign 274 where each direction of the street begins."""
    kmh = street.profile.speed_kmh
    for is_right, side in ((True, street.profile.right), (False, street.profile.left)):
        if not any(lane.kind == "driving" for lane in side):
            continue
        kerb = sum(0.0 if lane.bay else lane.width_m for lane in side if lane.kind != "sidewalk")
        sign = xodr.Signal(
            s=6.0 if is_right else street.length_m - 6.0,
            t=(-1 if is_right else 1) * (kerb + 0.5),
            country="DE",
            Type="274",
            subtype=str(kmh),
            value=kmh,
            unit="km/h",
            id=str(street.id * 10 + (0 if is_right else 1)),
            name=f"limit {kmh}",
            dynamic=xodr.Dynamic.no,
            zOffset=2.0,
            orientation=xodr.Orientation.positive if is_right else xodr.Orientation.negative,
            height=0.6,
            width=0.6,
        )
        street.road.add_signal(sign)


def write(town: xodr.OpenDrive, controllers: dict[int, list[tuple[int, list[int]]]], path: Path) -> None:
    """Writes the file; `controllers` by junction, which the library does not know."""
    root = town.get_element()
    # The library writes the clock; the file shall keep still.
    root.find("header").set("date", "2026-01-01T00:00:00")
    first_junction = [child.tag for child in root].index("junction")
    for junction_id, groups in sorted(controllers.items(), reverse=True):
        junction = next(j for j in root.iter("junction") if j.get("id") == str(junction_id))
        elements = []
        for k, (controller_id, signals) in enumerate(groups):
            attributes = {"id": str(controller_id), "name": f"phase {controller_id}", "sequence": str(k)}
            element = ElementTree.Element("controller", attributes)
            for signal in signals:
                ElementTree.SubElement(element, "control", {"signalId": str(signal), "type": "0"})
            elements.append(element)
            reference = {"id": str(controller_id), "type": "0", "sequence": str(k)}
            ElementTree.SubElement(junction, "controller", reference)
        root[first_junction:first_junction] = elements
    ElementTree.indent(root, " ")
    text = ElementTree.tostring(root, encoding="unicode")
    # Micrometres are enough, and the cubics of the widths need more digits only far behind the point.
    text = re.sub(r'"(-?\d+\.\d+(?:e-?\d+)?)"', lambda found: f'"{float(found[1]):.9g}"', text)
    path.write_text('<?xml version="1.0" encoding="utf-8"?>\n' + text + "\n", encoding="utf-8")


def write_town(name: str, crossings: list[Crossing], streets: list[Street], path: Path) -> None:
    by_id = {crossing.id: crossing for crossing in crossings}
    lay_out(by_id, streets)
    town = xodr.OpenDrive(name, revMinor="7")
    for street in streets:
        draw_street(street, by_id)
        add_speed_sign(street)
    junctions, connecting, controllers = [], [], {}
    for crossing in crossings:
        junction, roads = draw_crossing(crossing)
        junctions.append(junction)
        connecting.extend(roads)
        if crossing.has_lights:
            controllers[crossing.id] = add_lights(crossing)
    for road in [*(street.road for street in streets), *connecting]:
        town.add_road(road)
    for junction in junctions:
        town.add_junction(junction)
    write(town, controllers, path)
    ends = [(c.x, c.y) for c in crossings]
    spans = [max(p[k] for p in ends) - min(p[k] for p in ends) for k in (0, 1)]
    print(f"{name}: {len(streets)} streets, {len(crossings)} crossings, "
          f"{spans[0]:.0f} x {spans[1]:.0f} m, {path.stat().st_size // 1000} kB")  # fmt: skip
