"""Closed solids as triangle lists: boxes, extrusions, lofts, lathes, limbs.

A solid is (vertices [vertex, 3] in metres, faces [triangle, 3]), wound so that normals point out.
Faces that share a vertex are shaded smoothly by MuJoCo, so a crease is a doubled vertex.
"""

from __future__ import annotations

import math

import numpy as np

Solid = tuple[np.ndarray, np.ndarray]


def join(solids: list[Solid]) -> Solid:
    vertices, faces, start = [], [], 0
    for v, f in solids:
        vertices.append(v)
        faces.append(f + start)
        start += len(v)
    return np.concatenate(vertices), np.concatenate(faces)


def faceted(solid: Solid) -> Solid:
    """The same solid with every triangle on its own vertices: flat shading."""
    v, f = solid
    return v[f].reshape(-1, 3), np.arange(3 * len(f)).reshape(-1, 3)


def moved(solid: Solid, by=(0, 0, 0), yaw: float = 0, pitch: float = 0, roll: float = 0) -> Solid:
    """Turned about x by roll, y by pitch, z by yaw, then moved."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return solid[0] @ (about_z @ about_y @ about_x).T + np.asarray(by, float), solid[1]


def _outward(solid: Solid) -> Solid:
    v, f = solid
    a, b, c = v[f[:, 0]], v[f[:, 1]], v[f[:, 2]]
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum()
    return (v, f) if volume > 0 else (v, f[:, ::-1])


def triangulate(polygon: np.ndarray) -> np.ndarray:
    """Ear clipping of a simple polygon [vertex, 2], either winding."""
    x, y = polygon[:, 0], polygon[:, 1]
    ring = list(range(len(polygon)))
    if np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) < 0:
        ring.reverse()

    def cross(a, b, c):
        return (x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a])

    out = []
    while len(ring) > 3:
        for k in range(len(ring)):
            a, b, c = ring[k - 1], ring[k], ring[(k + 1) % len(ring)]
            if cross(a, b, c) <= 1e-12:
                continue
            inside = (p for p in ring if p not in (a, b, c))
            if any(min(cross(a, b, p), cross(b, c, p), cross(c, a, p)) >= 0 for p in inside):
                continue
            out.append((a, b, c))
            ring.pop(k)
            break
        else:  # only slivers are left
            ring.pop(1)
    out.append(tuple(ring))
    return np.array(out)


def loft(sections: list, smooth: bool = False) -> Solid:
    """Skin over sections [section, vertex, 3] of equal vertex count, with capped ends.

    The end caps are triangulated in the plane in which the section is widest.
    """
    rings = [np.asarray(s, float) for s in sections]
    n = len(rings[0])
    vertices = np.concatenate(rings)
    faces = []
    for r in range(len(rings) - 1):
        for k in range(n):
            a, b = r * n + k, r * n + (k + 1) % n
            faces += [(a, b, b + n), (a, b + n, a + n)]
    caps = []
    for ring, start, flip in ((rings[0], 0, True), (rings[-1], len(vertices) - n, False)):
        area = [
            abs(np.sum(ring[:, i] * np.roll(ring[:, j], -1) - np.roll(ring[:, i], -1) * ring[:, j]))
            for i, j in ((0, 1), (0, 2), (1, 2))
        ]
        i, j = ((0, 1), (0, 2), (1, 2))[int(np.argmax(area))]
        triangles = triangulate(ring[:, [i, j]])
        # Wind the cap against the skin: an edge k -> k+1 runs forwards in the first ring's skin.
        forwards = any(
            (t[m], t[(m + 1) % 3]) == (k, (k + 1) % n)
            for t in triangles.tolist()
            for m in range(3)
            for k in range(n)
        )
        if forwards == flip:
            triangles = triangles[:, ::-1]
        caps.append((ring, triangles) if smooth else (None, triangles + start))
    if not smooth:
        f = np.concatenate([np.array(faces), caps[0][1], caps[1][1]])
        return faceted(_outward((vertices, f)))
    # Decide the winding on the whole, then double the cap's vertices to keep the rim sharp.
    return _outward(join([(vertices, np.array(faces)), caps[0], caps[1]]))


def box(centre, size) -> Solid:
    (x, y, z), (l, w, h) = centre, size
    ring = [(x - l / 2, y - w / 2), (x + l / 2, y - w / 2), (x + l / 2, y + w / 2), (x - l / 2, y + w / 2)]
    return loft([[(*p, z - h / 2) for p in ring], [(*p, z + h / 2) for p in ring]])


def frustum(bottom, top) -> Solid:
    """Between two level rectangles, each (x_min, x_max, y_min, y_max, z)."""
    return loft([[(a, c, z), (b, c, z), (b, d, z), (a, d, z)] for a, b, c, d, z in (bottom, top)])


def extrude_y(profile, y_min: float, y_max: float) -> Solid:
    """A side view (x, z) swept across y."""
    return loft([[(x, y, z) for x, z in profile] for y in (y_min, y_max)])


def extrude_x(profile, x_min: float, x_max: float) -> Solid:
    """A front view (y, z) swept along x."""
    return loft([[(x, y, z) for y, z in profile] for x in (x_min, x_max)])


def lathe(profile, n: int = 14, sharp: bool = True) -> Solid:
    """Turns (radius, z), from the bottom axis to the top axis, about z; sharp keeps its creases."""
    pts = [(max(r, 1e-4), z) for r, z in profile]
    angle = 2 * math.pi * np.arange(n) / n
    ring = lambda r, z: np.stack([r * np.cos(angle), r * np.sin(angle), np.full(n, z)], 1)  # noqa: E731
    parts = []
    rows = [[pts[k], pts[k + 1]] for k in range(len(pts) - 1)] if sharp else [pts]
    for row in rows:
        v = np.concatenate([ring(r, z) for r, z in row])
        f = []
        for r in range(len(row) - 1):
            for k in range(n):
                a, b = r * n + k, r * n + (k + 1) % n
                if row[r][0] > 1e-3:
                    f.append((a, b, b + n))
                if row[r + 1][0] > 1e-3:
                    f.append((a, b + n, a + n))
        if f:
            parts.append((v, np.array(f)))
    return join(parts)


def cylinder(radius: float, z_min: float, z_max: float, n: int = 14, at=(0, 0), top=None) -> Solid:
    top = radius if top is None else top
    return moved(lathe([(0, z_min), (radius, z_min), (top, z_max), (0, z_max)], n), (*at, 0))


def between(start, end, r0: float, r1: float | None = None, n: int = 8, rounded: bool = False) -> Solid:
    """A round bar from one point to another; rounded gives a limb with domed ends."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    r1 = r0 if r1 is None else r1
    length = float(np.linalg.norm(end - start))
    if rounded:
        h = math.sqrt(0.5)
        profile = [
            (0, -r0),
            (r0 * h, -r0 * h),
            (r0, 0),
            (r1, length),
            (r1 * h, length + r1 * h),
            (0, length + r1),
        ]
    else:
        profile = [(0, 0), (r0, 0), (r1, length), (0, length)]
    v, f = lathe(profile, n, sharp=not rounded)
    z = (end - start) / length
    x = np.cross((0, 1, 0) if abs(z[1]) < 0.9 else (1, 0, 0), z)
    x /= np.linalg.norm(x)
    return v @ np.stack([x, np.cross(z, x), z]) + start, f


def ball(centre, radii, n: int = 10, rows: int = 6) -> Solid:
    a = np.linspace(-math.pi / 2, math.pi / 2, rows + 1)
    v, f = lathe([(math.cos(t), math.sin(t)) for t in a], n, sharp=False)
    return v * np.asarray(radii, float) + np.asarray(centre, float), f


def wheel(x: float, y: float, radius: float, width: float, n: int = 16) -> tuple[Solid, Solid]:
    """Tyre and rim of a wheel that rolls along x, standing on z = 0."""
    r, w = radius, width / 2
    tyre = lathe([(0, -w), (r * 0.9, -w), (r, -w * 0.7), (r, w * 0.7), (r * 0.9, w), (0, w)], n)
    rim = lathe([(0, -w - 0.012), (r * 0.62, -w - 0.012), (r * 0.62, w + 0.012), (0, w + 0.012)], n - 4)
    place = lambda s: moved(s, (x, y, r), roll=math.pi / 2)  # noqa: E731
    return place(tyre), place(rim)
