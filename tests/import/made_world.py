"""A small made world that drives: ground, boxes that stand or move, a car on a curve, LiDAR and cameras in
it.

Everything is analytic, so what an importer should find is known exactly. Frames: global (z up, ground at 0),
ego (x forward, y left, z up; at the rear axle on the ground, with a little roll and pitch as measured poses
have).
"""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw

WHEELBASE_M = 2.588  # Renault Zoe, nuScenes' car.
# Camera axes (right, down, forward) in axes forward, left, up.
FORWARD_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def turn(yaw_rad: float, pitch_rad: float = 0.0, roll_rad: float = 0.0) -> np.ndarray:
    """Rotation matrix: roll about x, then pitch about y, then yaw about z."""
    cy, sy, cp, sp, cr, sr = (
        np.cos(yaw_rad),
        np.sin(yaw_rad),
        np.cos(pitch_rad),
        np.sin(pitch_rad),
        np.cos(roll_rad),
        np.sin(roll_rad),
    )
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return about_z @ about_y @ about_x


def pose(rotation: np.ndarray, place_m: object) -> np.ndarray:
    """4x4 matrix."""
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = rotation, place_m
    return result


@dataclass
class Thing:
    """A box that moves at a constant velocity along its own heading, or stands."""

    category: str
    start_m: np.ndarray  # bottom centre in global at time 0
    size_m: np.ndarray  # length, width, height
    yaw_rad: float
    speed_mps: float = 0.0

    def pose_at(self, time_s: float) -> np.ndarray:
        """global_from_box, at the box's middle."""
        ahead = np.array([np.cos(self.yaw_rad), np.sin(self.yaw_rad), 0.0])
        place = self.start_m + ahead * self.speed_mps * time_s + [0, 0, self.size_m[2] / 2]
        return pose(turn(self.yaw_rad), place)


@dataclass
class Drive:
    """A car on a circle's arc whose speed changes steadily, and the things round it."""

    start_m: np.ndarray
    yaw_rad: float
    speed_mps: float
    acceleration_mps2: float
    steering_rad: float
    things: list[Thing]

    def speed_at(self, time_s: float) -> float:
        """Along the ego's x, m/s."""
        return self.speed_mps + self.acceleration_mps2 * time_s

    def level_pose_at(self, time_s: float) -> np.ndarray:
        """global_from_ego of a car without roll and pitch."""
        way = self.speed_mps * time_s + self.acceleration_mps2 * time_s**2 / 2
        curvature = np.tan(self.steering_rad) / WHEELBASE_M
        yaw = self.yaw_rad + curvature * way
        if abs(curvature) < 1e-9:
            ahead = np.array([np.cos(yaw), np.sin(yaw)]) * way
        else:
            ahead = np.array([np.sin(yaw) - np.sin(self.yaw_rad), np.cos(self.yaw_rad) - np.cos(yaw)]) / (
                curvature
            )
        return pose(turn(yaw), [*(self.start_m[:2] + ahead), 0.0])

    def pose_at(self, time_s: float) -> np.ndarray:
        """global_from_ego, with the little roll and pitch of a measured pose (up to a quarter of a
        degree).
        """
        sway = pose(turn(0.0, 0.004 * np.sin(1.3 * time_s + 0.4), 0.003 * np.cos(0.9 * time_s)), [0, 0, 0])
        return self.level_pose_at(time_s) @ sway


def cast(
    global_from_sensor: np.ndarray, directions: np.ndarray, boxes: list[tuple[np.ndarray, np.ndarray]]
) -> tuple[np.ndarray, np.ndarray]:
    """Ranges [ray] (inf where nothing is hit within 80 m) and what is hit: -1 the ground, else the box's
    index.
    """
    origin = global_from_sensor[:3, 3]
    rays = directions @ global_from_sensor[:3, :3].T
    with np.errstate(divide="ignore"):
        ranges = np.where(rays[:, 2] < -1e-6, -origin[2] / rays[:, 2], np.inf)
    hit = np.full(len(rays), -1)
    for idx, (global_from_box, size) in enumerate(boxes):
        box_from_global = np.linalg.inv(global_from_box)
        start = box_from_global[:3, :3] @ origin + box_from_global[:3, 3]
        along = rays @ box_from_global[:3, :3].T
        with np.errstate(divide="ignore", invalid="ignore"):
            one, other = (-size / 2 - start) / along, (size / 2 - start) / along
        near, far = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
        struck = (near > 0.5) & (near < far) & (near < ranges)
        ranges[struck], hit[struck] = near[struck], idx
    ranges[ranges > 80.0] = np.inf
    return ranges, hit


def scan(
    global_from_lidar: np.ndarray,
    boxes: list[tuple[np.ndarray, np.ndarray]],
    elevations_rad: np.ndarray,
    n_columns: int,
    random: np.random.Generator,
    turned_rad: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """A turn of a LiDAR: points [n, 5] (x, y, z, intensity 0 to 255, ring) in its frame, and what each
    hit.
    """
    azimuth = np.linspace(0, 2 * np.pi, n_columns, endpoint=False) + turned_rad
    ring = np.tile(np.arange(len(elevations_rad)), n_columns)
    azimuth, elevation = np.repeat(azimuth, len(elevations_rad)), np.tile(elevations_rad, n_columns)
    directions = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1
    )
    ranges, hit = cast(global_from_lidar, directions, boxes)
    seen = np.isfinite(ranges)
    # A little behind the face, so that it is inside of the box after rounding and laying upright, too.
    ranges = np.where(hit >= 0, ranges + 0.06, ranges)
    points = directions[seen] * ranges[seen, None]
    intensity = np.round(
        np.where(hit[seen] >= 0, 40 + 13 * (hit[seen] % 8), 12) + random.integers(0, 6, seen.sum())
    )
    return np.c_[points, intensity, ring[seen]].astype("<f4"), hit[seen]


FACES = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
SIGNS = np.array([[x, y, z] for x in (1, -1) for y in (1, -1) for z in (1, -1)]) / 2.0


def paint(
    global_from_camera: np.ndarray,
    k: np.ndarray,
    size_px: tuple[int, int],
    boxes: list[tuple[np.ndarray, np.ndarray]],
    colours: list[tuple[int, int, int]],
    form: str = "JPEG",
) -> bytes:
    """The picture of a camera: sky, ground, boxes from far to near, as an encoded file."""
    width, height = size_px
    picture = Image.new("RGB", size_px, (150, 180, 215))
    draw = ImageDraw.Draw(picture)
    forward = global_from_camera[:3, 2]
    # The horizon lies where directions with z = 0 go.
    level = np.array([forward[0], forward[1], 0.0])
    in_camera = global_from_camera[:3, :3].T @ level
    horizon = float(k[1, 2] + k[1, 1] * in_camera[1] / in_camera[2])
    draw.rectangle([0, horizon, width, height], fill=(95, 95, 98))
    camera_from_global = np.linalg.inv(global_from_camera)
    shown = []
    for (global_from_box, size), colour in zip(boxes, colours, strict=True):
        corners = (SIGNS * size) @ global_from_box[:3, :3].T + global_from_box[:3, 3]
        corners = corners @ camera_from_global[:3, :3].T + camera_from_global[:3, 3]
        if (corners[:, 2] < 0.5).any():
            continue
        pixels = corners @ k.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        for idx, face in enumerate(FACES):
            shade = 0.55 + 0.08 * idx
            shown.append(
                (
                    float(corners[list(face), 2].mean()),
                    [tuple(pixels[i]) for i in face],
                    tuple(int(c * shade) for c in colour),
                )
            )
    for _, outline, colour in sorted(shown, key=lambda one: -one[0]):
        draw.polygon(outline, fill=colour, outline=(20, 20, 20))
    stream = io.BytesIO()
    picture.save(stream, form, **({"quality": 85} if form == "JPEG" else {}))
    return stream.getvalue()


def inside(points_m: np.ndarray, frame_from_box: np.ndarray, size_m: np.ndarray) -> np.ndarray:
    """Which points [n, 3] lie in a box of the same frame."""
    box_from_frame = np.linalg.inv(frame_from_box)
    local = points_m @ box_from_frame[:3, :3].T + box_from_frame[:3, 3]
    return (np.abs(local) <= size_m / 2).all(axis=1)


def quaternion(rotation: np.ndarray) -> list[float]:
    """w, x, y, z of a rotation matrix."""
    w = np.sqrt(max(0.0, 1 + np.trace(rotation))) / 2
    if w > 0.1:
        x = (rotation[2, 1] - rotation[1, 2]) / (4 * w)
        y = (rotation[0, 2] - rotation[2, 0]) / (4 * w)
        z = (rotation[1, 0] - rotation[0, 1]) / (4 * w)
        return [float(v) for v in (w, x, y, z)]
    values, vectors = np.linalg.eigh(rotation + rotation.T)
    axis = vectors[:, np.argmax(values)]
    x, y, z = axis * np.sqrt(max(0.0, 1 - w * w))
    if (rotation[2, 1] - rotation[1, 2]) * x + (rotation[0, 2] - rotation[2, 0]) * y + (
        rotation[1, 0] - rotation[0, 1]
    ) * z < 0:
        x, y, z = -x, -y, -z
    return [float(v) for v in (w, x, y, z)]
