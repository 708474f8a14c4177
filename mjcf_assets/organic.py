"""Curved and irregular solids: swept tubes, blended limbs, rounded boxes, dents and broken stone.

A solid is what `solids.py` says; vertices are shared where the surface is smooth. No random numbers: noise is
a hash of the lattice point and a seed.
"""

from __future__ import annotations

import math

import numpy as np
from simplify import decimated
from solids import Solid, box, faceted, join, moved


def spline(points, n: int) -> np.ndarray:
    """N points along a Catmull-Rom curve through the points; further columns, such as radii, go along."""
    p = np.asarray(points, float)
    p = np.concatenate([2 * p[:1] - p[1:2], p, 2 * p[-1:] - p[-2:-1]])
    out = []
    for s in np.linspace(0, len(p) - 3, n):
        k = min(int(s), len(p) - 4)
        a, b, c, d = p[k : k + 4]
        t = s - k
        out.append(
            0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3)
        )
    return np.array(out)


def length(v: np.ndarray) -> float:
    """Of one vector, summed in order: `norm` and `@` sum as the processor likes, which shows in hulls."""
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


def frames(path: np.ndarray, closed: bool = False) -> list[np.ndarray]:
    """Side and up at each point of a path, turned as little as can be; rows of [2, 3]."""
    n = len(path)
    ahead = [
        path[(k + 1) % n if closed else min(k + 1, n - 1)] - path[k - 1 if closed else max(k - 1, 0)]
        for k in range(n)
    ]
    ahead = [a / length(a) for a in ahead]
    up = np.array((0.0, 0.0, 1.0) if abs(ahead[0][2]) < 0.9 else (0.0, 1.0, 0.0))
    out = []
    for a in ahead:
        up = up - a * (up[0] * a[0] + up[1] * a[1] + up[2] * a[2])
        up /= length(up)
        out.append(np.stack([np.cross(up, a), up]))
    return out


def sweep(path, section, scale=1.0, closed: bool = False, sharp: bool = False) -> Solid:
    """A closed section [vertex, 2] (side, up) carried along a path [point, 3]; scale may be one a point."""
    path, section = np.asarray(path, float), np.asarray(section, float)
    scale = np.broadcast_to(np.asarray(scale, float), len(path))
    # Not a matrix product: see `length`.
    across, along = section[:, :1], section[:, 1:]
    rings = [p + (s * across * f[0] + s * along * f[1]) for p, s, f in zip(path, scale, frames(path, closed))]
    n, m = len(section), len(path)
    v = np.concatenate(rings)
    f = []
    for r in range(m if closed else m - 1):
        for k in range(n):
            a, b = r * n + k, r * n + (k + 1) % n
            c, d = (r + 1) % m * n + k, (r + 1) % m * n + (k + 1) % n
            f += [(a, b, d), (a, d, c)]
    parts = [(v, np.array(f))]
    if not closed:
        for ring, turned in ((rings[0], True), (rings[-1], False)):
            fan = np.array([(n, k, (k + 1) % n) for k in range(n)])
            parts.append((np.concatenate([ring, ring.mean(0)[None]]), fan[:, ::-1] if turned else fan))
    whole = outward(join(parts))
    return creased(faceted(whole)) if sharp else whole


def outward(solid: Solid) -> Solid:
    v, f = solid
    volume = np.einsum("ij,ij->i", v[f[:, 0]], np.cross(v[f[:, 1]], v[f[:, 2]])).sum()
    return (v, f) if volume > 0 else (v, f[:, ::-1])


def circle(n: int, wide: float = 1.0, high: float = 1.0) -> list[tuple[float, float]]:
    turn = 2 * math.pi / n
    return [(wide * math.cos(turn * k), high * math.sin(turn * k)) for k in range(n)]


def rounded_rectangle(wide: float, high: float, r: float, n: int = 3) -> list[tuple[float, float]]:
    """Counter-clockwise, about the origin; n pieces a corner."""
    out = []
    for k, (x, z) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        for j in range(n + 1):
            t = math.pi / 2 * (k + j / n)
            out.append((x * (wide / 2 - r) + r * math.cos(t), z * (high / 2 - r) + r * math.sin(t)))
    return out


def tube(points, n: int = 8, steps: int | None = None, wide: float = 1.0, closed: bool = False) -> Solid:
    """A round limb through points (x, y, z, radius); with steps, along a smooth curve. Ends are domed."""
    p = np.asarray(points, float)
    p = spline(p, steps) if steps else p
    if closed:
        return sweep(p[:, :3], circle(n, wide), p[:, 3], closed=True)
    ends = []
    for at, to in ((p[0], p[1]), (p[-1], p[-2])):
        out = (at[:3] - to[:3]) / length(at[:3] - to[:3])
        ends.append(np.append(at[:3] + out * at[3] * 0.6, at[3] * 0.55))
    p = np.concatenate([ends[0][None], p, ends[1][None]])
    return sweep(p[:, :3], circle(n, wide), p[:, 3])


def torus(radius: float, r: float, n: int = 24, m: int = 8, high: float = 1.0) -> Solid:
    """A ring about z through the origin; high is how tall its section is against its width."""
    turn = 2 * math.pi / n
    path = [(radius * math.cos(turn * k), radius * math.sin(turn * k), 0) for k in range(n)]
    return sweep(path, circle(m, r, r * high), closed=True)


def pillow(centre, size, n: int = 6, round_to: float = 4.0) -> Solid:
    """A box with curved sides, a superellipsoid: 2 is a ball, 4 a cushion, 10 a box with soft edges."""
    grid = np.tan(np.linspace(-1, 1, n + 1) * math.pi / 4)
    v, f = [], []
    for axis in range(3):
        for side in (1, -1):
            start = sum(len(part) for part in v)
            a, b = np.meshgrid(grid, grid, indexing="ij")
            p = np.stack([np.full_like(a, side), a, b], -1).reshape(-1, 3)
            v.append(np.roll(p, axis, axis=1))
            for i in range(n):
                for j in range(n):
                    k = start + i * (n + 1) + j
                    quad = (k, k + n + 1, k + n + 2, k + 1)
                    quad = quad if side > 0 else quad[::-1]
                    f += [quad[:3], (quad[0], quad[2], quad[3])]
    v = np.concatenate(v)
    v = v / (np.abs(v) ** round_to).sum(1, keepdims=True) ** (1 / round_to)
    v, f = welded((v, np.array(f)))
    return v * np.asarray(size, float) / 2 + np.asarray(centre, float), f


def welded(solid: Solid) -> Solid:
    """Vertices at the same micrometre become one."""
    v, f = solid
    _, first, index = np.unique(np.round(v, 6) + 0.0, axis=0, return_index=True, return_inverse=True)
    f = index.reshape(-1)[f]
    kept = (f[:, 0] != f[:, 1]) & (f[:, 1] != f[:, 2]) & (f[:, 2] != f[:, 0])
    return v[first], f[kept]


def creased(solid: Solid) -> Solid:
    """Vertices at the same place with the same normal become one: half the file, the same shading."""
    v, f = solid
    normal = np.zeros_like(v)
    cross = np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]])
    for k in range(3):
        np.add.at(normal, f[:, k], cross)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    key = np.round(np.concatenate([v * 1e4, normal * 50], 1)) + 0.0
    _, first, index = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return v[first], index.reshape(-1)[f]


def block(centre, size) -> Solid:
    """A box in a smaller file than `box`."""
    return creased(box(centre, size))


def noise(points: np.ndarray, scale_m: float, seed: int) -> np.ndarray:
    """Smooth values from -1 to 1, with features of scale_m."""
    p = np.asarray(points, float) / scale_m + 31.7 * seed
    base = np.floor(p).astype(np.int64)
    t = p - base
    t = t * t * (3 - 2 * t)
    total = np.zeros(len(p))
    for corner in np.ndindex(2, 2, 2):
        k = (base + corner).astype(np.uint64)
        h = k[:, 0] * np.uint64(73856093) ^ k[:, 1] * np.uint64(19349663) ^ k[:, 2] * np.uint64(83492791)
        h = (h ^ (h >> np.uint64(13))) * np.uint64(1274126177) & np.uint64(0xFFFFFFFF)
        value = ((h >> np.uint64(8)) & np.uint64(0xFFFF)).astype(float) / 32767.5 - 1
        total += value * np.prod(np.where(corner, t, 1 - t), axis=1)
    return total


def rough(solid: Solid, amplitude_m: float, scale_m: float, seed: int) -> Solid:
    """Every point moved by smooth noise; points that coincide stay together."""
    v, f = solid
    by = np.stack([noise(v + 7.3 * k, scale_m, seed + k) for k in range(3)], 1)
    return v + amplitude_m * by, f


def bent(solid: Solid, way) -> Solid:
    """Points [vertex, 3] sent through a function."""
    return way(solid[0].copy()), solid[1]


def stone(centre, size, seed: int, n: int = 3, sharp: bool = True) -> Solid:
    """A broken piece: a ball cut by planes that a hash turns."""
    v, f = pillow((0, 0, 0), (2, 2, 2), n, 2.0)
    for k in range(9):
        apart = np.array([[0, 0, 0], [5, 0, 0], [0, 5, 0], [0, 0, 5]])
        h = noise(apart + np.array((k * 1.37, seed * 2.11, 0.5)), 0.37, seed)
        out = h[:3] / max(np.linalg.norm(h[:3]), 1e-6)
        depth = v @ out - (0.62 + 0.16 * h[3])
        v = v - np.maximum(depth, 0)[:, None] * out
    low, high = v.min(0), v.max(0)
    v = ((v - low) / (high - low) - 0.5) * np.asarray(size, float) + np.asarray(centre, float)
    return creased(faceted((v, f))) if sharp else (v, f)


def chain(*points, flat: float = 1.0) -> list[tuple]:
    """Limbs from point to point (x, y, z, radius) for `blend`; flat squeezes them in y."""
    return [(a, b, flat) for a, b in zip(points, points[1:])]


def blend(limbs: list[tuple], cell_m: float, soft_m: float, n_triangles: int) -> Solid:
    """One smooth body of limbs that melt into each other over soft_m: a level surface, simplified.

    Each limb is two ends (x, y, z, radius) and how much it is squeezed in y. What is thinner than two cells
    vanishes.
    """
    ends = np.array([end for limb in limbs for end in limb[:2]], float)
    reach = ends[:, 3:].max() * 1.2 + 3 * cell_m
    low, high = ends[:, :3].min(0) - reach, ends[:, :3].max(0) + reach
    counts = np.ceil((high - low) / cell_m).astype(int) + 1
    axes = [low[k] + cell_m * np.arange(counts[k]) for k in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    total = np.zeros(len(grid))
    for a, b, flat in limbs:
        a, b = np.asarray(a, float), np.asarray(b, float)
        squeeze = np.array((1, flat, 1))
        along = (b - a)[:3] / squeeze
        off = (grid - a[:3]) / squeeze
        t = np.clip(off @ along / max(along @ along, 1e-9), 0, 1)
        distance = np.linalg.norm(off - t[:, None] * along, axis=1) - (a[3] + t * (b[3] - a[3]))
        total += np.exp(np.clip(-distance / soft_m, -60, 60))
    field = np.round(-soft_m * np.log(total + 1e-30), 7).reshape(counts)
    v, f = level_surface(field, low, cell_m)
    return decimated((v, f), n_triangles)


def level_surface(field: np.ndarray, low: np.ndarray, cell_m: float) -> Solid:
    """Surface nets (Gibson 1998) of a field [x, y, z] that is negative inside: one vertex a cut cell."""
    inside = field < 0
    corners = list(np.ndindex(2, 2, 2))
    shape = tuple(s - 1 for s in field.shape)

    def part(array, c):
        return array[tuple(slice(o, o + s) for o, s in zip(c, shape))]

    total, count = np.zeros((*shape, 3)), np.zeros(shape)
    for a in corners:
        for axis in range(3):
            if a[axis]:
                continue
            b = tuple(o + (k == axis) for k, o in enumerate(a))
            fa, fb = part(field, a), part(field, b)
            cut = part(inside, a) != part(inside, b)
            t = np.where(cut, fa / np.where(cut, fa - fb, 1), 0)
            for k in range(3):
                total[..., k] += np.where(cut, a[k] + (t if k == axis else 0), 0)
            count += cut
    cells = np.argwhere(count > 0)
    index = np.full(shape, -1)
    index[tuple(cells.T)] = np.arange(len(cells))
    v = low + cell_m * (cells + total[tuple(cells.T)] / count[tuple(cells.T)][:, None])
    faces = []
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        step = np.eye(3, dtype=int)
        first = inside[tuple(slice(0, -1) if k == axis else slice(1, -1) for k in range(3))]
        second = inside[tuple(slice(1, None) if k == axis else slice(1, -1) for k in range(3))]
        for at in np.argwhere(first != second):
            turned = second[tuple(at)]
            at = at + 1 - step[axis]
            quad = [index[tuple(at - o)] for o in (0 * step[i], step[i], step[i] + step[j], step[j])]
            quad = quad[::-1] if turned else quad
            faces += [quad[:3], [quad[0], quad[2], quad[3]]]
    return v, np.array(faces)


def painted(solid: Solid, material_of) -> dict[str, list[Solid]]:
    """The faces of a solid by the material that a function of their centre gives."""
    v, f = solid
    names = [material_of(*centre) for centre in v[f].mean(1)]
    out = {}
    for name in dict.fromkeys(names):
        own = f[[k for k, other in enumerate(names) if other == name]]
        used, index = np.unique(own, return_inverse=True)
        out[name] = [(v[used], index.reshape(own.shape))]
    return out


def laid(m, roll: float = 0.0, pitch: float = 0.0) -> None:
    """Turns all parts of a model, so that it lies as physics leaves it, and sets it on z = 0."""
    m.parts = {name: [moved(s, roll=roll, pitch=pitch) for s in solids] for name, solids in m.parts.items()}
    low = min(s[0][:, 2].min() for solids in m.parts.values() for s in solids)
    m.parts = {name: [moved(s, (0, 0, -low)) for s in solids] for name, solids in m.parts.items()}


def over_ground(solid: Solid) -> Solid:
    """What would be below the ground is pressed flat on it."""
    v, f = solid
    return np.column_stack([v[:, :2], np.maximum(v[:, 2], 0.003)]), f
