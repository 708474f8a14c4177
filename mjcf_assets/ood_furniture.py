"""Lost furniture, each in three shapes: mattresses and sofas.

Only the test split shows them.
"""

from __future__ import annotations

import math

import numpy as np
from kinds import unseen
from model_writer import Model
from organic import bent, block, circle, laid, painted, pillow, rough, rounded_rectangle, sweep
from solids import Solid, ball, between, moved


def mattresses() -> list[Model]:
    """Flat with a sag, folded over, and on its long edge with a lean."""
    out = []
    l, w, h = 2.0, 0.9, 0.2
    a = unseen(
        "mattress_a",
        "Single mattress that lies with a buckle in it.",
        16,
        0.55,
        cover=(0.86, 0.84, 0.79),
        piping=(0.42, 0.50, 0.60),
        label=(0.15, 0.30, 0.55),
    )

    def buckle(v):
        v[:, 2] += 0.20 * np.exp(-(((v[:, 0] - 0.15 + 0.2 * v[:, 1]) / 0.28) ** 2))
        return v

    a.add("cover", bent(quilt(l, w, h), buckle))
    a.add("piping", *piping(l, w, h, buckle))
    a.add("label", bent(block((-0.7, 0.453, 0.1), (0.2, 0.012, 0.1)), buckle))
    for x, length, z, pitch in (
        (-0.62, 0.76, 0.1, 0.0),
        (0.72, 0.56, 0.1, 0.0),
        (-0.05, 0.5, 0.2, -0.35),
        (0.34, 0.4, 0.2, 0.4),
    ):
        a.collide_box((x, 0, z), (length, w, h), pitch)
    out.append(a)
    b = unseen(
        "mattress_b",
        "Double mattress, folded over.",
        28,
        0.5,
        cover=(0.56, 0.62, 0.70),
        piping=(0.80, 0.80, 0.78),
    )

    def fold(v):
        # The length goes once round a half circle.
        inner, length = 0.06, 0.95
        s, t = v[:, 0] + l / 2, v[:, 2]
        turn = math.pi * (inner + h / 2)
        angle = np.clip((s - length) / turn, 0, 1) * math.pi
        x = np.where(s < length, s, np.where(s > length + turn, 2 * length + turn - s, length)) + (
            inner + h - t
        ) * np.sin(angle)
        z = inner + h - (inner + h - t) * np.cos(angle)
        return np.stack([x, v[:, 1], z + 0.03 * np.sin(2.5 * v[:, 1] + x)], 1)

    b.add("cover", bent(quilt(l, 1.4, h, 24), fold))
    b.add("piping", *piping(l, 1.4, h, fold))
    b.collide_hull(*b.parts["cover"])
    out.append(b)
    c = unseen(
        "mattress_c",
        "Striped mattress on its long edge, slumped.",
        20,
        0.5,
        cover=(0.72, 0.70, 0.62),
        stripe=(0.30, 0.38, 0.52),
        piping=(0.25, 0.26, 0.30),
    )

    def slump(v):
        v = v[:, [0, 2, 1]] * (1, -1, 1)
        z = v[:, 2] + 0.4
        return np.stack(
            [
                v[:, 0],
                v[:, 1] + 0.24 * np.sin(1.5 * v[:, 0]) + 0.16 * (z / 0.8) ** 2 * np.cos(2 * v[:, 0]),
                z * (1 - 0.12 * np.cos(1.6 * v[:, 0])),
            ],
            1,
        )

    whole = quilt(1.9, 0.8, 0.17, 27)
    for material, solids in painted(
        whole, lambda x, y, z: "stripe" if int((x + 0.95) / (1.9 / 13)) % 2 else "cover"
    ).items():
        c.add(material, *(bent(s, slump) for s in solids))
    c.add("piping", *piping(1.9, 0.8, 0.17, slump))
    v = np.concatenate([s[0] for s in c.everything()])
    for low in np.linspace(v[:, 0].min(), v[:, 0].max(), 5)[:-1]:
        piece = v[(v[:, 0] >= low - 0.03) & (v[:, 0] <= low + 0.51)]
        c.collide_hull((piece, np.zeros((0, 3), int)))
    out.append(c)
    return out


def quilt(l: float, w: float, h: float, n: int = 20) -> Solid:
    """A soft slab on the ground, pressed in at the buttons of its quilting."""
    section = rounded_rectangle(w, h, h * 0.35, 2)
    wide = [p for k, p in enumerate(section)]
    # More points across the top and the bottom, where it is quilted.
    ring = []
    for (x0, z0), (x1, z1) in zip(wide, wide[1:] + wide[:1]):
        steps = 6 if abs(x1 - x0) > w / 2 else 1
        ring += [(x0 + (x1 - x0) * k / steps, z0 + (z1 - z0) * k / steps) for k in range(steps)]
    v, f = sweep([(x, 0, h / 2) for x in np.linspace(-l / 2, l / 2, n)], ring)
    dent = 0.018 * np.cos(2 * math.pi * v[:, 0] / 0.4) * np.cos(2 * math.pi * v[:, 1] / 0.3)
    v = v + np.stack([0 * dent, 0 * dent, dent * np.sign(v[:, 2] - h / 2)], 1)
    return v, f


def piping(l: float, w: float, h: float, way) -> list[Solid]:
    """The rolled edges of a mattress, top and bottom."""
    out = []
    for z in (0.012, h - 0.012):
        path = []
        for (x0, y0), (x1, y1) in zip(
            rounded_rectangle(l, w, 0.06, 1), np.roll(rounded_rectangle(l, w, 0.06, 1), -1, 0)
        ):
            n = max(1, round(math.hypot(x1 - x0, y1 - y0) / 0.12))
            path += [(x0 + (x1 - x0) * k / n, y0 + (y1 - y0) * k / n, z) for k in range(n)]
        path = way(np.array(path))
        out.append(sweep(path, circle(4, 0.014, 0.014), closed=True))
    return out


def sofas() -> list[Model]:
    return [two_seater(), armchair(), chesterfield()]


def two_seater() -> Model:
    m = unseen(
        "sofa_a",
        "Two-seat sofa with loose cushions.",
        42,
        0.35,
        fabric=(0.24, 0.36, 0.42),
        cushion=(0.29, 0.43, 0.50),
        throw=(0.86, 0.62, 0.20),
        wood=(0.36, 0.24, 0.14),
    )
    m.add("fabric", pillow((0, 0, 0.26), (0.86, 1.62, 0.26), 3, 9))
    m.add("fabric", moved(pillow((0, 0, 0), (0.22, 1.62, 0.56), 3, 6), (-0.36, 0, 0.58), pitch=-0.2))
    m.add("fabric", *(pillow((0.0, s * 0.78, 0.40), (0.84, 0.20, 0.48), 4, 5) for s in (1, -1)))
    m.add(
        "cushion",
        *(rough(pillow((0.08, s * 0.34, 0.455), (0.66, 0.66, 0.20), 5, 4.5), 0.008, 0.2, 3) for s in (1, -1)),
    )
    m.add(
        "cushion",
        *(
            rough(
                moved(pillow((0, 0, 0), (0.20, 0.64, 0.46), 5, 3.5), (-0.24, s * 0.34, 0.68), pitch=-0.25),
                0.008,
                0.2,
                4,
            )
            for s in (1, -1)
        ),
    )
    m.add(
        "throw",
        moved(pillow((0, 0, 0), (0.16, 0.42, 0.42), 5, 2.6), (0.02, 0.42, 0.72), pitch=-0.4, roll=0.5),
    )
    m.add(
        "wood",
        *(
            between((x, y, 0.15), (1.08 * x, 1.03 * y, 0), 0.03, 0.02, 8)
            for x in (-0.34, 0.34)
            for y in (-0.7, 0.7)
        ),
    )
    m.collide_box((0.02, 0, 0.27), (0.82, 1.70, 0.54))
    m.collide_hull(*m.parts["fabric"][1:2], *m.parts["cushion"])
    return m


def armchair() -> Model:
    """A wing chair tipped onto its back."""
    m = unseen(
        "sofa_b",
        "Wing armchair, tipped onto its back.",
        24,
        0.3,
        fabric=(0.52, 0.12, 0.13),
        cushion=(0.60, 0.16, 0.16),
        lining=(0.12, 0.11, 0.10),
        wood=(0.22, 0.13, 0.08),
    )

    def tip(s):
        return moved(s, (0, 0, 0.46), pitch=-math.pi / 2)

    m.add("fabric", tip(pillow((0.04, 0, 0.28), (0.66, 0.74, 0.24), 4, 8)))
    m.add("fabric", tip(moved(pillow((0, 0, 0), (0.17, 0.70, 0.80), 5, 4.5), (-0.34, 0, 0.68), pitch=-0.10)))
    m.add("fabric", *(tip(pillow((0.0, s * 0.36, 0.44), (0.66, 0.16, 0.36), 4, 3.2)) for s in (1, -1)))
    m.add(
        "fabric",
        *(
            tip(
                moved(
                    pillow((0, 0, 0), (0.30, 0.11, 0.48), 4, 2.6),
                    (-0.24, s * 0.36, 0.82),
                    pitch=-0.25,
                    yaw=-s * 0.2,
                )
            )
            for s in (1, -1)
        ),
    )
    m.add("cushion", tip(pillow((0.08, 0, 0.44), (0.58, 0.54, 0.18), 4, 4)))
    m.add("lining", tip(block((0.04, 0, 0.155), (0.58, 0.64, 0.02))))
    m.add(
        "wood",
        *(
            tip(between((x, y, 0.16), (x * 1.1, y * 1.05, 0), 0.028, 0.018, 8))
            for x in (-0.26, 0.32)
            for y in (-0.30, 0.30)
        ),
    )
    laid(m, 0.0, 0.10)
    m.collide_hull(*m.parts["fabric"], *m.parts["cushion"])
    m.collide_hull(*m.parts["wood"])
    return m


def chesterfield() -> Model:
    """A leather three-seater with rolled arms, on its front edge."""
    m = unseen(
        "sofa_c",
        "Three-seat leather sofa with rolled arms.",
        75,
        0.3,
        fabric=(0.30, 0.17, 0.09),
        cushion=(0.36, 0.21, 0.11),
        wood=(0.14, 0.09, 0.06),
        stud=(0.70, 0.56, 0.26),
    )
    m.add("fabric", pillow((0.02, 0, 0.25), (0.84, 1.96, 0.30), 4, 9))
    back = [(-0.36, y, 0.60) for y in (-1.02, -0.5, 0, 0.5, 1.02)]
    roll = [
        (0.16 * math.cos(t) * (1 if math.cos(t) > 0 else 0.8), 0.12 * math.sin(t))
        for t in (2 * math.pi * k / 10 for k in range(10))
    ]
    m.add("fabric", sweep(back, roll), moved(pillow((0, 0, 0), (0.2, 2.0, 0.42), 3, 6), (-0.36, 0, 0.42)))
    for s in (1, -1):
        m.add(
            "fabric",
            sweep([(x, s * 1.0, 0.60) for x in (-0.44, 0, 0.42)], roll),
            pillow((0.0, s * 0.98, 0.38), (0.84, 0.18, 0.40), 3, 7),
        )
        m.add(
            "stud",
            *(
                ball((0.425, s * 1.0 + 0.11 * math.cos(t), 0.60 + 0.09 * math.sin(t)), (0.016,) * 3, 4, 2)
                for t in np.linspace(0, 2 * math.pi, 9)[:-1]
            ),
        )
    m.add(
        "cushion",
        *(rough(pillow((0.08, y, 0.43), (0.64, 0.60, 0.19), 4, 4), 0.01, 0.2, 5) for y in (-0.60, 0, 0.60)),
    )
    # Buttons pull the back in.
    v, f = moved(pillow((0, 0, 0), (0.14, 1.8, 0.34), 9, 7), (-0.26, 0, 0.62))
    v[:, 0] += 0.022 * np.sin(v[:, 1] * 21) * np.sin(v[:, 2] * 32)
    m.add("cushion", (v, f))
    m.add(
        "wood", *(ball((x, y, 0.055), (0.05, 0.05, 0.055), 6, 4) for x in (-0.34, 0.36) for y in (-0.9, 0.9))
    )
    m.collide_box((0, 0, 0.27), (0.84, 2.1, 0.54))
    m.collide_hull(*m.parts["fabric"][1:2])
    return m
