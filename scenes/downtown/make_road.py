# Writes road.xodr beside this script. Needs Python 3.11 and scenariogeneration==0.16.7.
"""Downtown: four by four crossings, two-way streets, right-hand traffic, flat.

Streets run along +x and +y between the crossings. Lanes, from the middle outwards: driving 3.5 m,
on some streets parking 2.3 m (its width falls to zero before a crossing, so that all streets meet
with the same section), sidewalk 2.5 m. Crossings in the middle and on the rim are OpenDRIVE
junctions with one connecting road for each movement; the sidewalk round a corner belongs to the
connecting road that turns right there. The four corners of the town are plain curved roads.

Metres, radians. The origin is the middle of the town. No randomness: same file every time.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

from scenariogeneration import xodr

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from roadkit import add_light, write

X_M = (-134.0, -46.0, 38.0, 134.0)
Y_M = (-126.0, -42.0, 46.0, 126.0)
CROSSING_RADIUS_M = 13.0  # a street ends this far from the middle of its crossing
DRIVING_M, PARKING_M, SIDEWALK_M = 3.5, 2.3, 2.5
PARKING_START_M, PARKING_TAPER_M = 8.0, 3.0  # clear of the crosswalk
CROSSWALK_S_M = (1.0, 4.0)
URBAN_KMH, CALM_KMH = 50, 30
# About 2.5 m/s^2 sideways at the radius of each lane's middle (11.25 m and 14.75 m).
RIGHT_TURN_KMH, LEFT_TURN_KMH = 19, 22

# Parking on the (right, left) of the street, by row and column of the grid.
ROW_PARKING = {1: (True, True), 2: (True, False)}
COLUMN_PARKING = {1: (True, True)}
CALM_COLUMNS = {2}
# Crossings with traffic lights, by column and row: all four arms, and the parking streets' ends.
LIT = {(1, 1), (2, 1), (1, 2), (2, 2), (1, 0), (0, 1)}

# Arms of a crossing: the heading away from it. A street leaves eastwards and northwards, so it
# starts at the crossing on those arms and ends there on the others.
ARM_HEADING = {"east": 0.0, "north": math.pi / 2, "west": math.pi, "south": -math.pi / 2}


def starts_here(arm: str) -> bool:
    return arm in ("east", "north")


class Street:
    """One road between two crossings, and the lane numbers on its two sides."""

    def __init__(self, road_id: int, parking: tuple[bool, bool], speed_kmh: int):
        self.id = road_id
        self.parking = parking
        self.speed_kmh = speed_kmh
        self.road: xodr.Road | None = None
        self.length_m = 0.0

    def sidewalk(self, right: bool) -> int:
        n_lanes = 3 if self.parking[0 if right else 1] else 2
        return -n_lanes if right else n_lanes


def mark(kind: str) -> xodr.RoadMark:
    if kind == "broken":
        return xodr.RoadMark(xodr.RoadMarkType.broken, width=0.12, length=3, space=4.5)
    if kind == "solid":
        return xodr.RoadMark(xodr.RoadMarkType.solid, width=0.12)
    if kind == "curb":
        return xodr.RoadMark(xodr.RoadMarkType.curb, width=0.15)
    return xodr.RoadMark(xodr.RoadMarkType.none)


def parking_lane(length_m: float) -> xodr.Lane:
    """Zero, up to full width, down to zero: cubics with level ends."""
    c, d = 3 * PARKING_M / PARKING_TAPER_M**2, 2 * PARKING_M / PARKING_TAPER_M**3
    lane = xodr.Lane(xodr.LaneType.parking, a=0.0)
    lane.add_lane_width(a=0.0, c=c, d=-d, soffset=PARKING_START_M)
    lane.add_lane_width(a=PARKING_M, soffset=PARKING_START_M + PARKING_TAPER_M)
    end = length_m - PARKING_START_M
    lane.add_lane_width(a=PARKING_M, c=-c, d=d, soffset=end - PARKING_TAPER_M)
    lane.add_lane_width(a=0.0, soffset=end)
    lane.add_roadmark(mark("curb"))
    return lane


def side(length_m: float, parking: bool) -> list[xodr.Lane]:
    driving = xodr.Lane(xodr.LaneType.driving, a=DRIVING_M)
    driving.add_roadmark(mark("solid" if parking else "curb"))
    lanes = [driving]
    if parking:
        lanes.append(parking_lane(length_m))
    lanes.append(xodr.Lane(xodr.LaneType.sidewalk, a=SIDEWALK_M))
    return lanes


def section(centre_mark: str, right: list[xodr.Lane], left: list[xodr.Lane]) -> xodr.Lanes:
    centre = xodr.Lane(xodr.LaneType.none)
    centre.add_roadmark(mark(centre_mark))
    result = xodr.LaneSection(0, centre)
    for lane in right:
        result.add_right_lane(lane)
    for lane in left:
        result.add_left_lane(lane)
    lanes = xodr.Lanes()
    lanes.add_lanesection(result)
    return lanes


def add_crosswalk(road: xodr.Road, s_m: tuple[float, float], object_id: str) -> None:
    length, middle = s_m[1] - s_m[0], (s_m[0] + s_m[1]) / 2
    walk = xodr.Object(
        middle,
        0,
        xodr.ObjectType.crosswalk,
        id=object_id,
        name="crosswalk",
        length=length,
        width=2 * DRIVING_M,
        height=0.0,
    )
    outline = xodr.Outline(closed=True, id=0)
    for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        outline.add_corner(xodr.CornerLocal(u * length / 2, v * DRIVING_M, 0, 0))
    walk.add_outline(outline)
    road.add_object(walk)


def straight_street(
    street: Street, start: tuple[float, float], heading: float, length: float, name: str
) -> None:
    plan = xodr.PlanView()
    plan.add_fixed_geometry(xodr.Line(length), *start, heading)
    lanes = section("broken", side(length, street.parking[0]), side(length, street.parking[1]))
    road = xodr.Road(street.id, plan, lanes, name=name)
    road.add_type(xodr.RoadType.town, speed=street.speed_kmh, speed_unit="km/h")
    add_crosswalk(road, CROSSWALK_S_M, f"{street.id}0")
    add_crosswalk(road, (length - CROSSWALK_S_M[1], length - CROSSWALK_S_M[0]), f"{street.id}1")
    street.road, street.length_m = road, length


def turn_geometry(centre: tuple[float, float], arm_in: str, arm_out: str):
    """Plan view from one arm of a crossing to another, and the sign of its curvature."""
    heading = ARM_HEADING[arm_in] + math.pi
    x = centre[0] + CROSSING_RADIUS_M * math.cos(ARM_HEADING[arm_in])
    y = centre[1] + CROSSING_RADIUS_M * math.sin(ARM_HEADING[arm_in])
    turn = math.remainder(ARM_HEADING[arm_out] - heading, 2 * math.pi)
    plan = xodr.PlanView()
    if abs(turn) < 1e-9:
        plan.add_fixed_geometry(xodr.Line(2 * CROSSING_RADIUS_M), x, y, heading % (2 * math.pi))
        return plan, 0
    sign = 1 if turn > 0 else -1
    arc = xodr.Arc(sign / CROSSING_RADIUS_M, length=CROSSING_RADIUS_M * math.pi / 2)
    plan.add_fixed_geometry(arc, x, y, heading % (2 * math.pi))
    return plan, sign


def contact(arm: str) -> xodr.ContactPoint:
    return xodr.ContactPoint.start if starts_here(arm) else xodr.ContactPoint.end


def town_corner(road_id: int, centre, arms: dict[str, Street]) -> xodr.Road:
    """A curved road between the two streets that meet at a corner of the town."""
    arm_in, arm_out = sorted(arms)
    plan, _ = turn_geometry(centre, arm_in, arm_out)
    sides = (side(0, False), side(0, False))
    # The road runs with a street that ends where it begins, and with one that starts where it ends.
    flip_in = -1 if starts_here(arm_in) else 1
    flip_out = 1 if starts_here(arm_out) else -1
    for lanes, sign in zip(sides, (-1, 1)):
        for rank, lane in enumerate(lanes, start=1):
            lane.add_link("predecessor", sign * rank * flip_in)
            lane.add_link("successor", sign * rank * flip_out)
            for arm, flip in ((arm_in, flip_in), (arm_out, flip_out)):
                section_here = arms[arm].road.lanes.lanesections[0]
                own = sign * rank * flip
                lane_there = section_here.rightlanes if own < 0 else section_here.leftlanes
                lane_there[abs(own) - 1].add_link(
                    "predecessor" if starts_here(arm) else "successor", sign * rank
                )
    road = xodr.Road(road_id, plan, section("solid", *sides), name=f"corner {road_id}")
    road.add_type(xodr.RoadType.town, speed=RIGHT_TURN_KMH, speed_unit="km/h")
    road.add_predecessor(xodr.ElementType.road, arms[arm_in].id, contact(arm_in))
    road.add_successor(xodr.ElementType.road, arms[arm_out].id, contact(arm_out))
    for arm, point in ((arm_in, xodr.ContactPoint.start), (arm_out, xodr.ContactPoint.end)):
        link = arms[arm].road.add_predecessor if starts_here(arm) else arms[arm].road.add_successor
        link(xodr.ElementType.road, road_id, point)
    return road


def crossing(junction_id: int, centre, arms: dict[str, Street]):
    """A junction and its connecting roads: one for each pair of different arms."""
    junction = xodr.Junction(f"crossing {junction_id}", junction_id)
    roads = []
    pairs = [(a, b) for a in ARM_HEADING for b in ARM_HEADING if a != b and {a, b} <= set(arms)]
    for index, (arm_in, arm_out) in enumerate(pairs):
        plan, sign = turn_geometry(centre, arm_in, arm_out)
        right_of = {"east": "north", "north": "west", "west": "south", "south": "east"}[arm_in]
        has_sidewalk = sign < 0 or (sign == 0 and right_of not in arms)
        # Going in, one drives on the right of a street that ends here, on the left of one that
        # starts here; going out it is the other way round.
        right_in, right_out = not starts_here(arm_in), starts_here(arm_out)
        street_in, street_out = arms[arm_in], arms[arm_out]
        links = [(-1 if right_in else 1, -1 if right_out else 1)]
        lanes = [xodr.Lane(xodr.LaneType.driving, a=DRIVING_M)]
        lanes[0].add_roadmark(mark("curb" if has_sidewalk else "none"))
        if has_sidewalk:
            lanes.append(xodr.Lane(xodr.LaneType.sidewalk, a=SIDEWALK_M))
            links.append((street_in.sidewalk(right_in), street_out.sidewalk(right_out)))
        for lane, (lane_in, lane_out) in zip(lanes, links):
            lane.add_link("predecessor", lane_in)
            lane.add_link("successor", lane_out)
        road_id = junction_id * 100 + index
        road = xodr.Road(
            road_id, plan, section("none", lanes, []), road_type=junction_id, name=f"{arm_in} to {arm_out}"
        )
        speed = {-1: RIGHT_TURN_KMH, 0: street_in.speed_kmh, 1: LEFT_TURN_KMH}[sign]
        road.add_type(xodr.RoadType.town, speed=speed, speed_unit="km/h")
        road.add_predecessor(xodr.ElementType.road, street_in.id, contact(arm_in))
        road.add_successor(xodr.ElementType.road, street_out.id, contact(arm_out))
        connection = xodr.Connection(street_in.id, road_id, xodr.ContactPoint.start)
        for rank, (lane_in, _) in enumerate(links, start=1):
            connection.add_lanelink(lane_in, -rank)
        junction.add_connection(connection)
        roads.append(road)
    for arm, street in arms.items():
        link = street.road.add_predecessor if starts_here(arm) else street.road.add_successor
        link(xodr.ElementType.junction, junction_id)
    return junction, roads


def lights(junction_id: int, arms: dict[str, Street]) -> list[tuple[int, list[int]]]:
    """Lights on every approach, and controllers: east with west, north with south."""
    controllers = []
    for k, axis in enumerate((("east", "west"), ("north", "south"))):
        signals = []
        for arm in axis:
            if arm not in arms:
                continue
            street, is_end = arms[arm].road, not starts_here(arm)
            signal_id = junction_id * 1000 + list(ARM_HEADING).index(arm)
            beside = DRIVING_M + 0.6
            lane, t = (-1, -beside) if is_end else (1, beside)
            add_light(street, signal_id, arms[arm].length_m, is_end, t, (lane, lane))
            signals.append(signal_id)
        controllers.append((junction_id * 1000 + 500 + k, signals))
    return controllers


def build() -> tuple[xodr.OpenDrive, dict[int, list[tuple[int, list[int]]]]]:
    town = xodr.OpenDrive("downtown", revMinor="7")
    rows, columns = {}, {}
    for j, y in enumerate(Y_M):
        for i in range(len(X_M) - 1):
            street = Street(1 + j * 3 + i, ROW_PARKING.get(j, (False, False)), URBAN_KMH)
            length = X_M[i + 1] - X_M[i] - 2 * CROSSING_RADIUS_M
            straight_street(street, (X_M[i] + CROSSING_RADIUS_M, y), 0.0, length, f"street {j}")
            rows[i, j] = street
    for i, x in enumerate(X_M):
        for j in range(len(Y_M) - 1):
            speed = CALM_KMH if i in CALM_COLUMNS else URBAN_KMH
            street = Street(21 + i * 3 + j, COLUMN_PARKING.get(i, (False, False)), speed)
            length = Y_M[j + 1] - Y_M[j] - 2 * CROSSING_RADIUS_M
            start = (x, Y_M[j] + CROSSING_RADIUS_M)
            straight_street(street, start, math.pi / 2, length, f"avenue {i}")
            columns[i, j] = street

    more_roads, junctions, controllers = [], [], {}
    for j, y in enumerate(Y_M):
        for i, x in enumerate(X_M):
            found = {
                "east": rows.get((i, j)),
                "west": rows.get((i - 1, j)),
                "north": columns.get((i, j)),
                "south": columns.get((i, j - 1)),
            }
            arms = {arm: street for arm, street in found.items() if street is not None}
            if len(arms) == 2:
                more_roads.append(town_corner(41 + j * 4 + i, (x, y), arms))
                continue
            junction, roads = crossing(100 + j * 4 + i, (x, y), arms)
            junctions.append(junction)
            if (i, j) in LIT:
                controllers[100 + j * 4 + i] = lights(100 + j * 4 + i, arms)
            more_roads.extend(roads)
    for street in [*rows.values(), *columns.values()]:
        town.add_road(street.road)
    for road in more_roads:
        town.add_road(road)
    for junction in junctions:
        town.add_junction(junction)
    return town, controllers


def main() -> None:
    town, controllers = build()
    write(town, controllers, Path(__file__).with_name("road.xodr"))


if __name__ == "__main__":
    main()
