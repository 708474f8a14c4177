"""Flat things, harmful by their area alone: cardboard and manhole covers, each in three shapes.

Only the test split shows them.
"""

from __future__ import annotations

import math

import numpy as np
from kinds import unseen
from model_writer import Model
from organic import block, pillow
from solids import Solid, cylinder, lathe, moved


def cardboard_sheets() -> list[Model]:
    """A curled sheet, one with a crease that stands up, a box laid flat with its flaps."""
    a = unseen(
        "cardboard_sheet_a",
        "Large sheet of cardboard with curled corners.",
        1.6,
        0.5,
        card=(0.68, 0.52, 0.34),
        tape=(0.80, 0.72, 0.50),
    )

    def curl(x, y):
        return 0.09 * max(0.0, x * y / 0.35 - 0.25) ** 1.5 + 0.012 * math.sin(5 * x + 3 * y) + 0.02

    a.add("card", sheet_of(1.5, 1.0, 15, 10, curl, lambda x, y: True))
    a.add("tape", sheet_of(1.5, 0.05, 15, 1, lambda x, y: curl(x, y) + 0.006, lambda x, y: True))
    b = unseen(
        "cardboard_sheet_b",
        "Cardboard with a crease, wet and torn at one side.",
        0.9,
        0.4,
        card=(0.52, 0.39, 0.26),
    )

    def fold(x, y):
        return 0.16 * max(0.0, 1 - abs(x + 0.15 * y) / 0.24) ** 1.3 + 0.014 * math.sin(9 * y + 4 * x) + 0.02

    def torn(x, y):
        return x < 0.42 + 0.12 * math.sin(13 * y) and not (x > 0.2 and abs(y + 0.1) < 0.06)

    b.add("card", sheet_of(1.15, 0.8, 18, 11, fold, torn))
    c = unseen(
        "cardboard_sheet_c",
        "Box of an appliance, trodden flat, its flaps out.",
        2.4,
        0.5,
        card=(0.76, 0.62, 0.44),
        print=(0.12, 0.24, 0.50),
        tape=(0.85, 0.8, 0.6),
    )

    def wave(x, y):
        return (
            0.028
            + 0.018 * math.sin(4 * x) * math.cos(5 * y)
            + 0.10 * max(0.0, abs(y) - 0.42)
            + 0.16 * max(0.0, x - 0.62)
        )

    def cross(x, y):
        return abs(y) < 0.40 or (-0.72 < x < -0.38) or (-0.30 < x < 0.28) or (0.34 < x < 0.70 and y > 0)

    c.add("card", sheet_of(1.9, 1.4, 22, 16, wave, cross))
    c.add("print", sheet_of(0.5, 0.4, 6, 5, lambda x, y: wave(x, y) + 0.009, lambda x, y: True))
    for m in (a, b, c):
        m.friction = (0.7, 0.01, 0.01)
        v = np.concatenate([v for v, _ in m.everything()])
        low, size = v.min(0), v.max(0) - v.min(0)
        middle = low + size / 2
        m.collide_box((middle[0], middle[1], low[2] + 0.02), (size[0], size[1], 0.04))
        m.collide_hull(*m.everything())
    return [a, b, c]


def sheet_of(l: float, w: float, nx: int, ny: int, height, keep) -> Solid:
    """A sheet 8 mm thick over the cells of a grid that are kept, at a height (x, y)."""
    xs, ys = np.linspace(-l / 2, l / 2, nx + 1), np.linspace(-w / 2, w / 2, ny + 1)
    kept = {
        (i, j) for i in range(nx) for j in range(ny) if keep((xs[i] + xs[i + 1]) / 2, (ys[j] + ys[j + 1]) / 2)
    }

    def at(i, j):
        return i * (ny + 1) + j

    n = (nx + 1) * (ny + 1)
    v = np.array([(x, y, height(x, y) + t) for t in (0.004, -0.004) for x in xs for y in ys])
    f = []
    for i, j in sorted(kept):
        quad = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]
        f += [(quad[0], quad[1], quad[2]), (quad[0], quad[2], quad[3])]
        f += [
            tuple(k + n for k in (quad[2], quad[1], quad[0])),
            tuple(k + n for k in (quad[3], quad[2], quad[0])),
        ]
        for (di, dj), p, q in (((0, -1), 0, 1), ((1, 0), 1, 2), ((0, 1), 2, 3), ((-1, 0), 3, 0)):
            if (i + di, j + dj) not in kept:
                a, b = quad[p], quad[q]
                f += [(b, a, a + n), (b, a + n, b + n)]
    f = np.array(f)
    used, index = np.unique(f, return_inverse=True)
    return v[used], index.reshape(f.shape)


def manhole_covers() -> list[Model]:
    """Round and ajar over its hole, square with one leaf pushed off, a grating tipped in its frame."""
    tones = {
        "iron": (0.25, 0.24, 0.23),
        "worn": (0.42, 0.40, 0.38),
        "hole": (0.02, 0.02, 0.02),
        "rust": (0.38, 0.24, 0.16),
    }
    a = unseen("manhole_cover_a", "Round manhole cover ajar on its frame.", 110, 0.3, **tones)
    a.add("iron", lathe([(0.31, 0.0), (0.40, 0.0), (0.39, 0.025), (0.325, 0.025), (0.31, 0.0)], 26))
    a.add("hole", lathe([(0, 0.0), (0.315, 0.0), (0.315, 0.006), (0, 0.006)], 22))

    def lid(s):
        return moved(s, (0.20, 0.08, 0.075), pitch=0.15, yaw=0.4)

    a.add(
        "worn",
        lid(
            lathe([(0, -0.035), (0.26, -0.035), (0.31, -0.01), (0.312, 0.01), (0.30, 0.016), (0, 0.016)], 26)
        ),
    )
    for r, n in ((0.11, 6), (0.18, 10), (0.25, 14)):
        a.add(
            "iron",
            *(
                lid(
                    moved(
                        block((r, 0, 0.018), (0.035, 0.03, 0.010)),
                        yaw=2 * math.pi * (k + 0.5 * (n == 10)) / n,
                    )
                )
                for k in range(n)
            ),
        )
    a.add("hole", *(lid(moved(cylinder(0.018, 0.010, 0.0175, 8), (x, 0, 0))) for x in (0.285, -0.285)))
    b = unseen(
        "manhole_cover_b",
        "Square double cover, one leaf pushed across the other.",
        150,
        0.3,
        **tones | {"worn": (0.34, 0.33, 0.33)},
    )
    b.add(
        "iron",
        *(
            pillow(c, s, 2, 10)
            for c, s in (
                ((0.52, 0, 0.015), (0.06, 0.86, 0.03)),
                ((-0.52, 0, 0.015), (0.06, 0.86, 0.03)),
                ((0, 0.42, 0.015), (1.08, 0.06, 0.03)),
                ((0, -0.42, 0.015), (1.08, 0.06, 0.03)),
            )
        ),
    )
    b.add("hole", block((0, 0, 0.003), (1.0, 0.8, 0.006)))
    for pose in (((-0.25, 0, 0.02), 0.0, 0.0), ((-0.02, 0.16, 0.075), 0.35, 0.07)):

        def leaf(s, pose=pose):
            return moved(s, pose[0], yaw=pose[1], pitch=pose[2])

        b.add("worn", leaf(pillow((0, 0, 0), (0.50, 0.80, 0.05), 2, 14)))
        b.add(
            "rust",
            *(
                leaf(
                    moved(
                        pillow((0, 0, 0.026), (0.10, 0.035, 0.012), 1, 3),
                        (x, y, 0),
                        yaw=0.8 * (-1) ** (i + j),
                    )
                )
                for i, x in enumerate((-0.16, 0, 0.16))
                for j, y in enumerate((-0.3, -0.15, 0, 0.15, 0.3))
            ),
        )
    c = unseen(
        "manhole_cover_c",
        "Street gully: its grating sits crosswise in the frame.",
        60,
        0.3,
        **tones | {"worn": (0.33, 0.29, 0.26)},
    )
    c.add(
        "iron",
        *(
            pillow(p, s, 2, 10)
            for p, s in (
                ((0.28, 0, 0.02), (0.06, 0.60, 0.04)),
                ((-0.28, 0, 0.02), (0.06, 0.60, 0.04)),
                ((0, 0.28, 0.02), (0.6, 0.06, 0.04)),
                ((0, -0.28, 0.02), (0.6, 0.06, 0.04)),
            )
        ),
    )
    c.add("hole", block((0, 0, 0.003), (0.54, 0.54, 0.006)))

    def grate(s):
        return moved(s, (0.02, 0.0, 0.13), yaw=0.65, pitch=-0.42)

    c.add(
        "worn",
        *(grate(pillow((0, 0.065 * k, 0), (0.48, 0.03, 0.05), 2, 8)) for k in range(-3, 4)),
        *(grate(pillow((x, 0, 0), (0.05, 0.48, 0.055), 2, 8)) for x in (-0.22, 0, 0.22)),
    )
    for m in (a, b, c):
        m.collide_hull(*m.everything())
    return [a, b, c]
