"""The zones `arc`, `ttc`, `rss` a second time: the bicycle model in small steps, bodies tried place by place.

Nothing here follows harmzone's way (closed forms, chains of quadrangles, conservative advancement). Each
check takes an ego state, the true objects, the zone's config and the written labels of one sample, and tells
what is wrong.
"""

import math

import numpy as np
import shapely
from shapely.geometry import Polygon

HARMFUL = 1
# harmzone's chords leave their arcs by up to 5 mm, and a gap of 1 cm is contact.
CHORD_M, TOUCH_M = 0.005, 0.01
# What is kept free about the centre of a turn.
CLEARANCE_M = 0.2
N_STEPS = 4000


def is_above(item: object, config: dict) -> bool:
    """Whether an object hangs too high over the ground to be harmful."""
    lowest_m = item.clearance_m if item.HasField("clearance_m") else item.z_m - item.height_m / 2
    return 0.0 < config["max_clearance_m"] < lowest_m


def middle_of(item: object) -> complex:
    """Middle of an object's footprint."""
    place = item.x_m + 1j * item.y_m
    if not item.HasField("solid"):
        return place
    return place + np.exp(1j * item.yaw_rad) * (item.solid.along_m + 1j * item.solid.across_m)


def footprints(items: list) -> np.ndarray:
    """Corners of the objects' footprints, [object, 4, 2], metres in the ego frame."""
    corners = []
    for item in items:
        size = item.solid if item.HasField("solid") else item
        half = np.array([1 + 1j, -1 + 1j, -1 - 1j, 1 - 1j])
        local = half.real * size.length_m / 2 + 1j * half.imag * size.width_m / 2
        placed = middle_of(item) + np.exp(1j * item.yaw_rad) * local
        corners.append(np.stack([placed.real, placed.imag], axis=1))
    return np.array(corners)


class Drive:
    """The rear axle's way: x' = cos(h), y' = sin(h), h' = tan(steering) / wheelbase, by metres along it."""

    def __init__(self, state: object, config: dict, length_m: float) -> None:
        self.rate = math.tan(state.steering_angle_rad) / state.wheelbase_m
        most_m = math.radians(config["max_turn_deg"]) / abs(self.rate) if self.rate else math.inf
        self.is_cut, self.length_m = length_m > most_m, min(length_m, most_m)
        self.along = np.linspace(0.0, self.length_m, N_STEPS + 1)
        middle = self.rate * (self.along[:-1] + self.along[1:]) / 2
        step = np.diff(self.along)
        self.places = np.concatenate([[0], np.cumsum(step * np.exp(1j * middle))])

    def moved(self, points: list[complex], along: np.ndarray) -> np.ndarray:
        """Points of the body after the rear axle ran so far (negative: back), [place, point], complex."""
        sign = np.sign(along)
        # Backwards, the way is the mirror image in y: the same turn to each metre, driven the other way.
        there = np.interp(np.abs(along), self.along, self.places.real) + 1j * np.interp(
            np.abs(along), self.along, self.places.imag
        )
        there = np.where(sign < 0, -np.conj(there), there)
        return there[:, None] + np.exp(1j * self.rate * along)[:, None] * np.array(points)[None, :]


def polygons(corners: np.ndarray) -> np.ndarray:
    """Shapely polygons of complex corners, [place, point]."""
    return shapely.polygons(np.stack([corners.real, corners.imag], axis=-1))


def body(front_m: float, rear_m: float, left_m: float, right_m: float) -> list[complex]:
    return [front_m + 1j * left_m, -rear_m + 1j * left_m, -rear_m - 1j * right_m, front_m - 1j * right_m]


def check_outline(written: object, expected: shapely.Geometry, slack_m2: float = 0.0) -> list[str]:
    """The drawn zone may leave the true one by the chords' distance along its border."""
    drawn = Polygon([(point.x_m, point.y_m) for point in written.zone])
    allowed = CHORD_M * expected.length + slack_m2 + 1e-6
    difference = drawn.buffer(0).symmetric_difference(expected).area
    return [f"the zone differs by {difference} m2"] if difference > allowed else []


def check_arc(state: object, objects: list, config: dict, written: object) -> list[str]:
    depth = config["time_gap_s"] * max(state.speed_mps, 0.0) + config["min_safe_distance_m"]
    drive, half = Drive(state, config, depth), config["width_m"] / 2
    ends = drive.moved([state.front_bumper_x_m - 1j * half, state.front_bumper_x_m + 1j * half], drive.along)
    ring = np.concatenate([ends[:, 0], ends[::-1, 1]])
    zone = Polygon(np.stack([ring.real, ring.imag], axis=1)).buffer(0)
    wrong = check_outline(written, zone)
    for item, label, corners in zip(objects, written.labels, footprints(objects), strict=True):
        footprint = Polygon(corners)
        area = footprint.intersection(zone).area
        # Two borders may cross the footprint.
        allowed = CHORD_M * footprint.length + 1e-6
        if abs(label.overlap_area_m2 - area) > allowed:
            wrong.append(f"`{item.id}` shares {label.overlap_area_m2} m2, shapely says {area}")
        least = min(config["min_overlap_area_m2"], config["min_overlap_ratio"] * footprint.area)
        if is_above(item, config):
            if label.harm == HARMFUL:
                wrong.append(f"`{item.id}` hangs above and is harmful")
        elif abs(area - least) > allowed and (label.harm == HARMFUL) != (area >= least):
            wrong.append(f"`{item.id}` has harm {label.harm} with {area} m2 of {footprint.area}")
    return wrong


def check_ttc(state: object, objects: list, config: dict, written: object) -> list[str]:
    horizon, step_s = config["ttc"]["horizon_s"], 0.005
    drive = Drive(state, config, abs(state.speed_mps) * horizon)
    if drive.is_cut:
        horizon = drive.length_m / abs(state.speed_mps)
    half = config["body"]["width_m"] / 2
    corners = body(state.front_bumper_x_m, config["body"]["rear_overhang_m"], half, half)
    times = np.append(np.arange(0.0, horizon, step_s), horizon)
    bodies = polygons(drive.moved(corners, state.speed_mps * times))
    along = np.linspace(0.0, drive.length_m if state.speed_mps > 0 else 0.0, 1000)
    swept = shapely.union_all(polygons(drive.moved(corners, along)))
    # The rear corner swings out of the start's place; the zone leaves that out.
    wrong = check_outline(written, swept, slack_m2=0.1)
    for item, label, base in zip(objects, written.labels, footprints(objects), strict=True):
        if is_above(item, config):
            if label.harm == HARMFUL or label.HasField("time_to_collision_s"):
                wrong.append(f"`{item.id}` hangs above and shall be met")
            continue
        velocity = item.vx_mps + 1j * item.vy_mps
        start = base[:, 0] + 1j * base[:, 1]
        gaps = shapely.distance(bodies, polygons(start[None, :] + velocity * times[:, None]))
        if label.harm != HARMFUL:
            if gaps.min() == 0.0 or label.HasField("time_to_collision_s"):
                wrong.append(f"`{item.id}` is harmless, but met at {times[gaps.argmin()]} s")
            continue
        time = np.array([label.time_to_collision_s])
        then = polygons(drive.moved(corners, state.speed_mps * time))
        gap = shapely.distance(then, polygons(start[None, :] + velocity * time[:, None]))[0]
        if gap > TOUCH_M + 1e-3 or time[0] > horizon + 1e-9:
            wrong.append(f"`{item.id}` shall be met at {time[0]} s, but {gap} m are between")
        if np.any(gaps[times < time[0] - 1e-9] == 0.0):
            wrong.append(f"`{item.id}` shall be met at {time[0]} s, but was met before")
    return wrong


def stop_m(speed: float, response_s: float, accel: float, brake: float) -> float:
    """The way while responding and then braking; one that moves away after its response brakes no more."""
    after = speed + response_s * accel
    return speed * response_s + 0.5 * accel * response_s**2 + (after**2 / (2 * brake) if after > 0 else 0.0)


def check_rss(state: object, objects: list, config: dict, written: object) -> list[str]:
    rss, half, wrong = config["rss"], config["body"]["width_m"] / 2, []
    rate = math.tan(state.steering_angle_rad) / state.wheelbase_m
    speed = max(state.speed_mps, 0.0)

    def own(brake: float) -> float:
        return stop_m(speed, rss["response_time_s"], rss["max_accel_mps2"], brake)

    def aside(towards: float) -> float:
        accel, brake = rss["lateral_max_accel_mps2"], rss["lateral_min_brake_mps2"]
        both = stop_m(0.0, rss["response_time_s"], accel, brake) + stop_m(
            towards, rss["other_response_time_s"], accel, brake
        )
        return rss["lateral_margin_m"] + max(both, 0.0)

    for item, label, base in zip(objects, written.labels, footprints(objects), strict=True):
        if is_above(item, config):
            if label.harm == HARMFUL:
                wrong.append(f"`{item.id}` hangs above and is harmful")
            continue
        # Across from the centre of the turn is the direction of the course.
        if abs(rate) < 1e-12:
            direction = 1 + 0j
        else:
            from_center = middle_of(item) - 1j / rate
            direction = from_center * 1j * np.sign(rate) / abs(from_center)
        seen = (item.vx_mps + 1j * item.vy_mps) / direction
        if seen.real > -rss["standing_speed_mps"]:
            ahead = own(rss["min_brake_mps2"]) - max(seen.real, 0.0) ** 2 / (2 * rss["max_brake_mps2"])
        else:
            ahead = own(rss["min_brake_correct_mps2"]) + stop_m(
                -seen.real, rss["other_response_time_s"], rss["max_accel_mps2"], rss["min_brake_mps2"]
            )
        left, right = half + aside(-seen.imag), half + aside(seen.imag)
        if abs(rate) > 1e-12:
            room = 1 / abs(rate) - CLEARANCE_M
            left, right = (min(left, room), right) if rate > 0 else (left, min(right, room))
        drive = Drive(state, config, max(ahead, 0.0))
        front = state.front_bumper_x_m
        # Behind the rear axle only the start counts.
        places = polygons(drive.moved(body(front, 0.0, left, right), np.linspace(0.0, drive.length_m, 1500)))
        start = polygons(np.array([body(front, config["body"]["rear_overhang_m"], left, right)]))
        places = np.concatenate([start, places])
        footprint = Polygon(base)
        is_deep = shapely.intersects(places, footprint.buffer(-2 * TOUCH_M, join_style="mitre")).any()
        is_near = shapely.distance(places, footprint).min() < 2 * TOUCH_M
        if (is_deep and label.harm != HARMFUL) or (not is_near and label.harm == HARMFUL):
            wrong.append(f"`{item.id}` has harm {label.harm}; {ahead} m ahead, {left} and {right} m aside")
    return wrong
