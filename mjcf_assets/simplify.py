"""Fewer triangles for a closed surface: edges fall together where that moves the surface least."""

from __future__ import annotations

import heapq

import numpy as np
from solids import Solid


def decimated(solid: Solid, n_triangles: int) -> Solid:
    """At most so many triangles, by quadric error metrics (Garland and Heckbert 1997); ties go by index."""
    v, f = solid
    points = [tuple(p) for p in np.round(v, 6).tolist()]
    quadrics = [np.zeros(10) for _ in points]
    triangles = {k: tuple(t) for k, t in enumerate(f.tolist())}
    around: list[set[int]] = [set() for _ in points]
    for k, t in triangles.items():
        a, b, c = v[list(t)]
        cross = np.cross(b - a, c - a)
        area = float(np.linalg.norm(cross)) or 1e-12
        x, y, z = cross / area
        d = -(x * a[0] + y * a[1] + z * a[2])
        plane = area * np.array([x * x, x * y, x * z, x * d, y * y, y * z, y * d, z * z, z * d, d * d])
        for corner in t:
            quadrics[corner] += plane
            around[corner].add(k)
    q = [tuple(row.tolist()) for row in quadrics]

    def error(w, p) -> float:
        x, y, z = p
        return (
            w[0] * x * x
            + 2 * w[1] * x * y
            + 2 * w[2] * x * z
            + 2 * w[3] * x
            + w[4] * y * y
            + 2 * w[5] * y * z
            + 2 * w[6] * y
            + w[7] * z * z
            + 2 * w[8] * z
            + w[9]
        )

    stamp = [0] * len(points)
    heap: list[tuple] = []

    def offer(a: int, b: int) -> None:
        a, b = min(a, b), max(a, b)
        w = tuple(i + j for i, j in zip(q[a], q[b]))
        pa, pb = points[a], points[b]
        middle = tuple((i + j) / 2 for i, j in zip(pa, pb))
        length2 = sum((i - j) ** 2 for i, j in zip(pa, pb))
        # A little for length, so that flat parts are thinned evenly.
        best = min((round(error(w, p) + 1e-6 * length2, 12), k) for k, p in enumerate((middle, pa, pb)))
        heapq.heappush(heap, (best[0], a, b, stamp[a], stamp[b], (middle, pa, pb)[best[1]]))

    def neighbours(a: int) -> set[int]:
        return {corner for k in around[a] for corner in triangles[k]} - {a}

    for a in range(len(points)):
        for b in sorted(neighbours(a)):
            if a < b:
                offer(a, b)

    def normal(p, q, r) -> tuple[float, float, float]:
        ax, ay, az, bx, by, bz = *(q[k] - p[k] for k in range(3)), *(r[k] - p[k] for k in range(3))
        return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx

    def dot(a, b) -> float:
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

    def flips(a: int, other: int, to) -> bool:
        for k in around[a]:
            t = triangles[k]
            if other in t:
                continue
            before = normal(*(points[c] for c in t))
            after = normal(*(to if c == a else points[c] for c in t))
            turned = dot(before, after)
            if turned < 0 or turned * turned < 0.04 * dot(before, before) * dot(after, after):
                return True
        return False

    while len(triangles) > n_triangles and heap:
        _, a, b, sa, sb, to = heapq.heappop(heap)
        if stamp[a] != sa or stamp[b] != sb:
            continue
        # More than two common neighbours: the surface would fold onto itself.
        if len(neighbours(a) & neighbours(b)) != 2 or flips(a, b, to) or flips(b, a, to):
            continue
        points[a] = to
        q[a] = tuple(i + j for i, j in zip(q[a], q[b]))
        for k in sorted(around[b]):
            t = tuple(a if c == b else c for c in triangles[k])
            for c in triangles[k]:
                around[c].discard(k)
            if len(set(t)) < 3:
                del triangles[k]
                continue
            triangles[k] = t
            for c in t:
                around[c].add(k)
        stamp[b] += 1
        stamp[a] += 1
        for c in sorted(neighbours(a)):
            offer(a, c)
    kept = np.array([triangles[k] for k in sorted(triangles)])
    used, index = np.unique(kept, return_inverse=True)
    return np.array([points[k] for k in used]), index.reshape(kept.shape)
