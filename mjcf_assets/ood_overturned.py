"""Bins and signs that lie where they should stand, each in three shapes.

Only the test split shows them.
"""

from __future__ import annotations

import math

import numpy as np
from kinds import unseen
from model_writer import Model
from organic import bent, block, laid, outward, over_ground, pillow, rough, rounded_rectangle, sweep, tube
from solids import Solid, ball, cylinder, extrude_x, lathe, moved


def wheelie_bins() -> list[Model]:
    """One on its face with its rubbish out, one on its side, a large one on its back with its lid open."""
    a = unseen(
        "wheelie_bin_a",
        "Bin of 120 l on its face, a bag half out.",
        14,
        0.4,
        body=(0.10, 0.28, 0.14),
        lid=(0.08, 0.22, 0.11),
        bag=(0.09, 0.09, 0.10),
        litter=(0.86, 0.84, 0.78),
    )
    wheelie_bin(a, 0.55, 0.48, 0.93, 1.2, lambda s: moved(s, (0, 0, 0.26), pitch=math.pi / 2 - 0.05))
    laid(a, 0.0, -0.02)
    a.add("bag", over_ground(rough(ball((0.98, 0.06, 0.17), (0.26, 0.22, 0.17), 12, 8), 0.035, 0.12, 4)))
    a.add(
        "litter",
        *(
            over_ground(rough(pillow((x, y, 0.045), (0.16, 0.12, 0.08), 2, 3), 0.02, 0.06, k))
            for k, (x, y) in enumerate(((1.22, -0.2), (1.10, -0.32), (1.34, 0.12)))
        ),
    )
    b = unseen(
        "wheelie_bin_b",
        "Bin of 240 l on its side, its lid swung open.",
        16,
        0.4,
        body=(0.20, 0.21, 0.23),
        lid=(0.12, 0.30, 0.62),
        bag=(0.9, 0.9, 0.9),
        litter=(0.7, 0.6, 0.4),
    )
    wheelie_bin(b, 0.72, 0.58, 1.07, 1.9, lambda s: moved(s, (0, 0, 0.29), roll=math.pi / 2 - 0.03))
    laid(b)
    b.add(
        "litter",
        *(
            over_ground(rough(pillow((x, y, 0.06), (0.24, 0.18, 0.11), 2, 4), 0.025, 0.08, k))
            for k, (x, y) in enumerate(((0.05, -1.28), (-0.22, -1.20)))
        ),
    )
    c = unseen(
        "wheelie_bin_c",
        "Bin of 360 l on its back, its lid flat on the road.",
        22,
        0.4,
        body=(0.48, 0.28, 0.13),
        lid=(0.90, 0.72, 0.08),
        bag=(0.2, 0.4, 0.6),
        litter=(0.7, 0.6, 0.4),
    )
    wheelie_bin(c, 0.85, 0.66, 1.10, 1.62, lambda s: moved(s, (0, 0, 0.42), pitch=-math.pi / 2 + 0.05))
    for m in (a, b, c):
        m.collide_hull(*m.parts["body"], *m.parts["tyre"])
        m.collide_hull(*m.parts["lid"])
    return [a, b, c]


def wheelie_bin(m: Model, d: float, w: float, h: float, open_rad: float, place) -> None:
    """Depth d along x with the handle at -x; the lid is open by an angle about its hinge."""
    rows = (
        (0.0, 0.70),
        (0.04, 0.76),
        (0.55, 0.88),
        (0.92, 0.98),
        (0.93, 1.04),
        (0.97, 1.04),
        (0.97, 0.95),
        (0.90, 0.92),
        (0.20, 0.76),
        (0.20, 0.0),
    )

    def ring(z, s):
        return [
            (s * x + 0.06 * d * (1 - s), s * y, z * h) for x, y in rounded_rectangle(0.86 * d, w, 0.08, 3)
        ]

    rings = [np.array(ring(z, max(s, 0.02))) for z, s in rows]
    n = len(rings[0])
    v = np.concatenate([*rings, [(0, 0, 0)]])
    f = [
        t
        for r in range(len(rings) - 1)
        for k in range(n)
        for t in (
            (r * n + k, r * n + (k + 1) % n, (r + 1) * n + (k + 1) % n),
            (r * n + k, (r + 1) * n + (k + 1) % n, (r + 1) * n + k),
        )
    ]
    f += [(len(v) - 1, (k + 1) % n, k) for k in range(n)]
    f += [
        ((len(rings) - 1) * n, (len(rings) - 1) * n + k, (len(rings) - 1) * n + k + 1)
        for k in range(1, n - 1)
    ]
    m.add("body", place(outward((v, np.array(f)))))

    def hinge(s):
        return place(moved(s, (-0.43 * d, 0, 0.985 * h), pitch=-open_rad))

    dome = pillow((0.45 * d, 0, 0.012), (0.94 * d, 1.06 * w, 0.06), 5, 7)
    m.add(
        "lid",
        hinge(
            bent(
                dome,
                lambda v: (
                    v + np.stack([0 * v[:, 0], 0 * v[:, 0], 0.05 * np.exp(-((v[:, 1] / (0.3 * w)) ** 2))], 1)
                ),
            )
        ),
    )
    m.add(
        "body",
        place(
            tube(
                [
                    (-0.44 * d, 0.36 * w, 0.94 * h, 0.018),
                    (-0.53 * d, 0.32 * w, 0.95 * h, 0.018),
                    (-0.53 * d, -0.32 * w, 0.95 * h, 0.018),
                    (-0.44 * d, -0.36 * w, 0.94 * h, 0.018),
                ],
                6,
            )
        ),
    )
    for s in (1, -1):
        m.add(
            "tyre",
            place(
                moved(
                    lathe(
                        [(0, -0.025), (0.07, -0.025), (0.1, -0.02), (0.1, 0.02), (0.07, 0.025), (0, 0.025)],
                        16,
                    ),
                    (-0.34 * d, s * 0.43 * w, 0.085),
                    roll=math.pi / 2,
                )
            ),
        )
    m.add(
        "body",
        *(place(pillow((0.0, s * 0.435 * w, 0.60 * h), (0.10 * d, 0.025, 0.55 * h), 2, 5)) for s in (1, -1)),
    )
    m.add(
        "white",
        place(
            moved(pillow((0, 0, 0), (0.012, 0.42 * w, 0.16 * h), 2, 6), (0.424 * d, 0, 0.70 * h), pitch=0.10)
        ),
    )


def fallen_signs() -> list[Model]:
    """A warning sign on its bent post, a round one tipped with its foot, a blue board on its legs."""
    a = unseen(
        "fallen_sign_a",
        "Warning sign, run over: bent post, concrete at its foot.",
        24,
        0.7,
        face=(0.95, 0.94, 0.90),
        rim=(0.80, 0.06, 0.06),
        post=(0.56, 0.57, 0.59),
        back=(0.50, 0.51, 0.52),
        concrete=(0.60, 0.59, 0.56),
    )
    way = [
        (-1.35, 0, 0.17, 0.03),
        (-0.95, 0.02, 0.16, 0.03),
        (-0.55, 0.05, 0.26, 0.03),
        (0.0, 0.06, 0.30, 0.03),
        (0.85, 0.08, 0.24, 0.03),
    ]
    a.add("post", tube(way, 9, 16))
    a.add("concrete", rough(pillow((-1.42, 0, 0.17), (0.36, 0.32, 0.34), 4, 3), 0.03, 0.12, 2))

    def plate(s):
        return moved(s, (0.62, 0.08, 0.30), roll=0.5, pitch=-0.14)

    def tri(r):
        return [(r * math.cos(t), r * math.sin(t)) for t in (0.0, 2.094, 4.189)]

    for material, r, z0, z1 in (
        ("rim", 0.56, 0.0, 0.012),
        ("face", 0.40, 0.012, 0.016),
        ("back", 0.55, -0.006, 0.0),
    ):
        a.add(material, plate(bent(rounded_prism(tri(r), 0.12 * r / 0.56, z0, z1), warp)))
    a.add(
        "black",
        plate(
            bent(
                rounded_prism(
                    [(0.18, 0.035), (-0.08, 0.02), (-0.08, -0.02), (0.18, -0.035)], 0.01, 0.016, 0.02
                ),
                warp,
            )
        ),
        plate(bent(moved(cylinder(0.03, 0.016, 0.02, 10), (-0.14, 0, 0)), warp)),
    )
    b = unseen(
        "fallen_sign_b",
        "Round prohibition sign on a plastic foot, tipped over.",
        30,
        0.7,
        face=(0.95, 0.94, 0.90),
        rim=(0.80, 0.06, 0.06),
        post=(0.85, 0.85, 0.83),
        red=(0.80, 0.06, 0.06),
        foot=(0.16, 0.15, 0.15),
        back=(0.5, 0.51, 0.52),
    )

    def down(s):
        return moved(s, (0, 0, 0.20), pitch=-1.24, roll=0.0)

    b.add(
        "foot",
        down(pillow((0, 0, 0.05), (0.42, 0.80, 0.11), 4, 5)),
        *(down(pillow((x, y, 0.05), (0.16, 0.14, 0.12), 2, 4)) for x in (-0.14, 0.14) for y in (-0.28, 0.28)),
    )
    b.add(
        "post",
        down(block((0, 0, 0.85), (0.04, 0.04, 1.6))),
        *(down(block((0.021, 0, z), (0.004, 0.042, 0.16))) for z in (0.3, 0.65)),
    )

    def face(s):
        return down(moved(s, (0.03, 0, 1.45), pitch=math.pi / 2))

    def disc(r, z0, z1):
        return bent(lathe([(0, z0), (r, z0), (r, z1), (0, z1)], 26), warp)

    b.add("rim", face(disc(0.30, 0, 0.012)))
    b.add("face", face(disc(0.225, 0.012, 0.016)))
    b.add(
        "black",
        *(
            face(
                bent(
                    rounded_prism(
                        [
                            (x + 0.07, y + 0.02),
                            (x - 0.07, y + 0.02),
                            (x - 0.07, y - 0.02),
                            (x + 0.07, y - 0.02),
                        ],
                        0.008,
                        0.016,
                        0.02,
                    ),
                    warp,
                )
            )
            for x, y in ((0.02, 0.06), (0.02, -0.06))
        ),
    )
    b.add("back", face(disc(0.295, -0.006, 0.0)))
    c = unseen(
        "fallen_sign_c",
        "Blue diversion board with an arrow, propped askew on its frame.",
        17,
        0.75,
        board=(0.08, 0.20, 0.62),
        arrow=(0.95, 0.95, 0.94),
        frame=(0.66, 0.67, 0.68),
        sack=(0.62, 0.50, 0.32),
        back=(0.5, 0.51, 0.52),
    )

    def lean(s):
        return moved(s, (0, 0, 0.40), pitch=-0.85, roll=0.16)

    sheet = sweep(
        [(0.0, y, 0.0) for y in np.linspace(-0.62, 0.62, 9)], rounded_rectangle(0.016, 0.70, 0.006, 1)
    )
    c.add(
        "board",
        lean(
            bent(sheet, lambda v: v + np.stack([0.03 * np.cos(2.4 * v[:, 1]), 0 * v[:, 0], 0 * v[:, 0]], 1))
        ),
    )
    arrow = [
        (0.44, 0.0),
        (0.14, 0.24),
        (0.14, 0.09),
        (-0.46, 0.09),
        (-0.46, -0.09),
        (0.14, -0.09),
        (0.14, -0.24),
    ]
    c.add(
        "arrow",
        lean(
            bent(
                extrude_x([(y, z) for y, z in arrow], 0.012, 0.026),
                lambda v: v + np.stack([0.03 * np.cos(2.4 * v[:, 1]), 0 * v[:, 0], 0 * v[:, 0]], 1),
            )
        ),
    )
    for s in (1, -1):
        c.add(
            "frame",
            lean(
                tube(
                    [
                        (-0.02, s * 0.5, 0.30, 0.017),
                        (-0.03, s * 0.5, -0.36, 0.017),
                        (-0.34, s * 0.5, -0.52, 0.017),
                        (-0.62, s * 0.46, -0.26, 0.017),
                    ],
                    6,
                )
            ),
        )
    c.add("frame", lean(tube([(-0.34, -0.5, -0.52, 0.015), (-0.34, 0.5, -0.52, 0.015)], 6)))
    for m, roll, pitch in ((a, -0.68, 0.07), (b, 0.0, -0.46), (c, -0.12, 0.10)):
        laid(m, roll, pitch)
    c.add("sack", over_ground(rough(pillow((-0.40, 0.12, 0.10), (0.32, 0.56, 0.18), 5, 3), 0.03, 0.12, 5)))
    for m in (a, b, c):
        m.collide_hull(*m.everything())
    return [a, b, c]


def warp(v: np.ndarray) -> np.ndarray:
    """A sheet of metal after a wheel went over it."""
    v[:, 2] += 0.035 * np.sin(4.5 * v[:, 0] + 1) * np.cos(5 * v[:, 1])
    return v


def rounded_prism(corners, r: float, z0: float, z1: float) -> Solid:
    """A convex outline with rounded corners as a plate that can be bent: rings about its middle."""
    p = np.array(corners, float)
    out = []
    for a, b, c in zip(np.roll(p, 1, 0), p, np.roll(p, -1, 0)):
        for t in np.linspace(0, 1, 4):
            start, end = b + (a - b) / np.linalg.norm(a - b) * r, b + (c - b) / np.linalg.norm(c - b) * r
            out.append((1 - t) ** 2 * start + 2 * t * (1 - t) * b + t**2 * end)
        out += [b + (c - b) * s for s in (0.4, 0.6)]
    ring = np.array(out)
    middle, n = ring.mean(0), len(ring)
    rows = [(0.5, z0), (1.0, z0), (1.0, z1), (0.5, z1)]
    v = np.concatenate(
        [np.column_stack([middle + s * (ring - middle), np.full(n, z)]) for s, z in rows]
        + [[(*middle, z0), (*middle, z1)]]
    )
    f = [
        t
        for q in range(3)
        for k in range(n)
        for t in (
            (q * n + k, q * n + (k + 1) % n, (q + 1) * n + (k + 1) % n),
            (q * n + k, (q + 1) * n + (k + 1) % n, (q + 1) * n + k),
        )
    ]
    f += [(4 * n, (k + 1) % n, k) for k in range(n)] + [
        (4 * n + 1, 3 * n + k, 3 * n + (k + 1) % n) for k in range(n)
    ]
    return outward((v, np.array(f)))
