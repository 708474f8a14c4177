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
from pathlib import Path
from xml.etree import ElementTree

from road_geometry import Plan, bend, turn_plan, wrapped
from road_network import (
    STRAIGHT_RAD,
    Arm,
    Crossing,
    Lane,
    Profile,
    Street,
    driving,
    lay_out,
    movements,
    pairs_around,
    phases,
)
from scenariogeneration import xodr

__all__ = ["Crossing", "Lane", "Profile", "Street", "bend", "driving", "write_town"]

SMALLEST_RADIUS_M = 5.5  # of a lane's middle
TAPER_M = 4.0
LATERAL_MPS2 = 2.5  # what a turn's speed limit allows sideways


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


def add_yield_signs(crossing: Crossing) -> None:
    """German sign 205 at the end of each street that gives way."""
    for arm in crossing.arms:
        if arm.street.id not in crossing.yields or not arm.open(True, "driving"):
            continue
        lanes = [entry[0] for entry in arm.open(True, "driving")]
        beside = arm.kerb_m(inbound=True) + 0.5
        sign = xodr.Signal(
            s=0.5 if arm.is_start else arm.street.length_m - 0.5,
            t=beside if arm.is_start else -beside,
            country="DE",
            Type="205",
            id=str(crossing.id * 1000 + 900 + crossing.arms.index(arm)),
            name="yield",
            dynamic=xodr.Dynamic.no,
            zOffset=2.0,
            orientation=xodr.Orientation.negative if arm.is_start else xodr.Orientation.positive,
            height=0.9,
            width=0.9,
        )
        sign.add_validity(min(lanes), max(lanes))
        arm.street.road.add_signal(sign)


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
        add_yield_signs(crossing)
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
