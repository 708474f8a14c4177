"""Leaves and twigs as loose triangles with gaps between them: beams pass through a crown in part.

A leaf here stands for a tuft of real ones, 15 to 30 cm across: as large as two or three beams of a LiDAR are
apart at 20 m. Both sides are faces of their own, since only outer sides are drawn.
"""

from __future__ import annotations

import math
import random

import numpy as np
from solids import Solid, between

Point = tuple[float, float, float]


def triangle(centre: Point, normal: np.ndarray, size_m: float, rng: random.Random) -> np.ndarray:
    """A triangle of about this size across a normal: [3, 3]."""
    normal = normal / max(float(np.linalg.norm(normal)), 1e-9)
    side = np.cross(normal, (0.0, 0.0, 1.0) if abs(normal[2]) < 0.9 else (1.0, 0.0, 0.0))
    side /= np.linalg.norm(side)
    up = np.cross(normal, side)
    start = rng.uniform(0, 2 * math.pi)
    corners = []
    for k in range(3):
        angle = start + 2 * math.pi * k / 3 + rng.uniform(-0.35, 0.35)
        radius = size_m * rng.uniform(0.45, 0.75)
        corners.append(np.asarray(centre) + radius * (math.cos(angle) * side + math.sin(angle) * up))
    return np.array(corners)


def sheets(triangles: list[np.ndarray], both_sides: bool = True) -> Solid:
    """Loose triangles; the two faces of one share their corners. Centimetres are enough."""
    corners = np.round(np.concatenate(triangles), 2)
    front = np.arange(len(corners)).reshape(-1, 3)
    return corners, np.concatenate([front, front[:, ::-1]]) if both_sides else front


def any_direction(rng: random.Random) -> np.ndarray:
    z, angle = rng.uniform(-1, 1), rng.uniform(0, 2 * math.pi)
    r = math.sqrt(1 - z * z)
    return np.array([r * math.cos(angle), r * math.sin(angle), z])


def in_balls(
    balls: list[tuple[Point, Point]], n: int, size_m: float, rng: random.Random, shell: float = 0.45
) -> list[np.ndarray]:
    """Leaves in ellipsoids (centre, radii), more near the skin, none deeper than `shell`."""
    volume = [math.prod(radii) ** (2 / 3) for _, radii in balls]
    leaves = []
    for (centre, radii), share in zip(balls, volume, strict=True):
        for _ in range(round(n * share / sum(volume))):
            out = any_direction(rng)
            depth = rng.uniform(shell**3, 1.0) ** (1 / 3)
            at = np.asarray(centre) + out * depth * np.asarray(radii)
            leaves.append(
                triangle(tuple(at), out + 1.1 * any_direction(rng), size_m * rng.uniform(0.7, 1.3), rng)
            )
    return leaves


def over_core(
    balls: list[tuple[Point, Point]], n: int, size_m: float, rng: random.Random
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Dense leaves that look outwards, and under them a rough skin: nothing shines through the middle."""
    leaves = [leaf for leaf in in_balls(balls, n, size_m, rng, shell=0.85) if leaf[:, 2].min() > 0.02]
    middle = np.mean([centre for centre, _ in balls], axis=0)
    skin = []
    for centre, radii in balls:
        skin += core(centre, 0.8 * np.asarray(radii), rng)
    return outward(leaves, middle), skin


def outward(leaves: list[np.ndarray], middle: np.ndarray) -> list[np.ndarray]:
    """The same leaves, with their faces away from the middle."""
    looks_in = lambda a, b, c: np.cross(b - a, c - a) @ ((a + b + c) / 3 - middle) < 0  # noqa: E731
    return [leaf[::-1] if looks_in(*leaf) else leaf for leaf in leaves]


def core(centre: Point, radii: np.ndarray, rng: random.Random, n: int = 5) -> list[np.ndarray]:
    """An uneven ball of few faces that stands on the ground."""
    rows = []
    for elevation in (-1.1, -0.1, 0.5, 1.1):
        ring = []
        for k in range(n):
            angle = 2 * math.pi * k / n + 0.4 * elevation
            scale = rng.uniform(0.8, 1.1)
            flat = math.cos(elevation) * scale
            offset = np.array([flat * math.cos(angle), flat * math.sin(angle), math.sin(elevation) * scale])
            at = np.asarray(centre) + offset * radii
            at[2] = max(at[2], 0.0)
            ring.append(at)
        rows.append(ring)
    top = np.asarray(centre) + np.array([0, 0, radii[2] * 1.02])
    faces = []
    for low, high in zip(rows, rows[1:], strict=False):
        for k in range(n):
            m = (k + 1) % n
            faces += [np.array([low[k], low[m], high[m]]), np.array([low[k], high[m], high[k]])]
    faces += [np.array([rows[-1][k], rows[-1][(k + 1) % n], top]) for k in range(n)]
    return faces


def limb(start: Point, end: Point, r0: float, r1: float, n: int = 5) -> Solid:
    return between(start, end, r0, r1, n=n)


def forks(
    start: np.ndarray, way: np.ndarray, radius: float, depth: int, rng: random.Random, spread: float = 0.55
) -> tuple[list[Solid], list[np.ndarray], list[np.ndarray]]:
    """Branches that fork `depth` times: round limbs, twigs as thin triangles, and the twigs' tips."""
    end = start + way
    if depth == 0:
        side = np.cross(way, any_direction(rng))
        side *= 0.022 / max(float(np.linalg.norm(side)), 1e-9)
        return [], [np.array([start - side, start + side, end])], [end]
    limbs, twigs, tips = (
        [limb(tuple(start), tuple(end), radius, 0.62 * radius, n=4 if depth > 2 else 3)],
        [],
        [],
    )
    for k in range(3 if depth > 1 else 4):
        lean = any_direction(rng) * spread * float(np.linalg.norm(way))
        turn = 0.72 * way + lean + np.array([0, 0, 0.08])
        at = start + way * (1.0 if k == 0 else rng.uniform(0.55, 1.0))
        more = forks(at, turn, 0.6 * radius, depth - 1, rng, spread)
        limbs, twigs, tips = limbs + more[0], twigs + more[1], tips + more[2]
    return limbs, twigs, tips
