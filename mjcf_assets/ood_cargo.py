"""Lost cargo, each in three shapes: what falls off trucks, vans and roof racks. Only the test split shows it."""

from __future__ import annotations

import math

import numpy as np
from kinds import unseen
from model_writer import Model
from organic import (
    bent,
    block,
    circle,
    frames,
    laid,
    painted,
    pillow,
    rough,
    rounded_rectangle,
    sweep,
    torus,
    tube,
)
from solids import Solid, ball, between, cylinder, lathe, moved


def mattresses() -> list[Model]:
    """Flat with a sag, folded over, and on its long edge with a lean."""
    out = []
    l, w, h = 2.0, 0.9, 0.2
    a = unseen(
        "mattress_a",
        "Single mattress that lies with a buckle in it.",
        16,
        0.55,
        colours={"cover": (0.86, 0.84, 0.79), "piping": (0.42, 0.50, 0.60), "label": (0.15, 0.30, 0.55)},
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
        colours={"cover": (0.56, 0.62, 0.70), "piping": (0.80, 0.80, 0.78)},
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
        "mattress_c", "Striped mattress on its long edge, slumped.", 20, 0.5,
        colours={"cover": (0.72, 0.70, 0.62), "stripe": (0.30, 0.38, 0.52), "piping": (0.25, 0.26, 0.30)},
    )  # fmt: skip

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
        "sofa_a", "Two-seat sofa with loose cushions.", 42, 0.35,
        colours={"fabric": (0.24, 0.36, 0.42), "cushion": (0.29, 0.43, 0.50), "throw": (0.86, 0.62, 0.20), "wood": (0.36, 0.24, 0.14)},
    )  # fmt: skip
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
    m.collide_hull(*m.parts["fabric"][1:2])
    return m


def armchair() -> Model:
    """A wing chair tipped onto its back."""
    m = unseen(
        "sofa_b", "Wing armchair, tipped onto its back.", 24, 0.3,
        colours={"fabric": (0.52, 0.12, 0.13), "cushion": (0.60, 0.16, 0.16), "lining": (0.12, 0.11, 0.10), "wood": (0.22, 0.13, 0.08)},
    )  # fmt: skip
    tip = lambda s: moved(s, (0, 0, 0.46), pitch=-math.pi / 2)  # noqa: E731
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
        "sofa_c", "Three-seat leather sofa with rolled arms.", 75, 0.3,
        colours={"fabric": (0.30, 0.17, 0.09), "cushion": (0.36, 0.21, 0.11), "wood": (0.14, 0.09, 0.06), "stud": (0.70, 0.56, 0.26)},
    )  # fmt: skip
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


def pallets() -> list[Model]:
    """A Euro pallet (EN 13698: 1.2 x 0.8 x 0.144 m) with a broken board, a half pallet on its side, three askew."""
    a = unseen("pallet_a", "Euro pallet with a broken and a missing board.", 23, 0.35, colours=WOOD)
    pallet(a, 1.2, 0.8, lambda s: s, missing=(1,), broken=(3,))
    a.collide_box((0, 0, 0.072), (1.2, 0.8, 0.144))
    blue = {"board": (0.10, 0.24, 0.55), "block": (0.08, 0.18, 0.42), "break": (0.74, 0.60, 0.40)}
    b = unseen(
        "pallet_b", "Blue pallet upside down, one corner up on a splintered block.", 27, 0.4, colours=blue
    )
    pallet(
        b,
        1.2,
        1.0,
        lambda s: moved(s, (0, 0, 0.3), roll=math.pi + 0.16, pitch=0.1),
        missing=(1,),
        broken=(3,),
    )
    b.add("break", rough(pillow((0.45, -0.38, 0.09), (0.22, 0.15, 0.2), 3, 8), 0.03, 0.08, 2))
    laid(b, -0.24, -0.10)
    b.collide_hull(*b.everything())
    c = unseen(
        "pallet_c",
        "Three Euro pallets, slipped off each other.",
        66,
        0.3,
        colours={"board": (0.46, 0.41, 0.35), "block": (0.37, 0.33, 0.28), "break": (0.62, 0.52, 0.38)},
    )
    for k, (yaw, x, y) in enumerate(((0.0, 0, 0), (0.3, 0.10, -0.05), (-0.12, -0.08, 0.12))):
        tilt = 0.09 if k == 2 else 0.0
        place = lambda s, k=k, yaw=yaw, x=x, y=y, tilt=tilt: moved(
            s, (x, y, 0.146 * k + 4.5 * tilt * 0.144 * 0.7), yaw=yaw, roll=tilt
        )  # noqa: E731
        pallet(c, 1.2, 0.8, place, missing=(2,) if k == 2 else (), broken=(0,) if k == 1 else ())
    c.collide_hull(*c.everything())
    return [a, b, c]


WOOD = {"board": (0.66, 0.52, 0.34), "block": (0.56, 0.43, 0.27), "break": (0.80, 0.67, 0.46)}


def pallet(m: Model, l: float, w: float, place, missing=(), broken=()) -> None:
    """Five boards on three cross boards on nine blocks on three runners, boards a little warped."""
    n = 5
    for k in range(n):
        y = -w / 2 + 0.0725 + k * (w - 0.145) / (n - 1)
        if k in missing:
            continue
        ends = [(-l / 2, l / 2)] if k not in broken else [(-l / 2, -0.02), (0.21, l / 2)]
        for low, high in ends:
            path = [
                (x, y + 0.004 * math.sin(5 * x + k), 0.133 + 0.006 * math.sin(4 * x + 2 * k) ** 2)
                for x in np.linspace(low, high, 5)
            ]
            m.add(
                "board",
                place(
                    sweep(
                        path, rounded_rectangle(0.13 if k in (0, 2, 4) else 0.09, 0.022, 0.004, 1), sharp=True
                    )
                ),
            )
        if k in broken:
            for j, (x, turn) in enumerate(((0.0, 0.25), (0.20, -0.2))):
                m.add(
                    "break",
                    place(
                        moved(
                            block((0, 0, 0), (0.12, 0.035, 0.014)),
                            (x, y + 0.02 * (-1) ** j, 0.136),
                            yaw=turn,
                            pitch=0.2 * turn,
                        )
                    ),
                )
    for x in (-l / 2 + 0.0725, 0, l / 2 - 0.0725):
        m.add("board", place(block((x, 0, 0.111), (0.13, w, 0.022))))
    for y in (-w / 2 + 0.05, 0, w / 2 - 0.05):
        m.add("board", place(block((0, y, 0.011), (l, 0.1, 0.022))))
        m.add(
            "block",
            *(place(block((x, y, 0.061), (0.13, 0.1, 0.078))) for x in (-l / 2 + 0.0725, 0, l / 2 - 0.0725)),
        )


def tyres() -> list[Model]:
    """A car's tyre on its side, a truck's standing, and a car's wheel with a rim, flat and torn."""
    a = unseen(
        "tyre_a",
        "Car tyre that lies on its side.",
        9,
        0.12,
        colours={"rubber": (0.07, 0.07, 0.075), "wall": (0.11, 0.11, 0.115)},
    )
    tyre(a, 0.316, 0.203, 0.205, lambda s: moved(s, (0, 0, 0.1025)), 28)
    a.rolls = "z"
    a.friction = (0.9, 0.01, 0.012)
    a.collide_cylinder((0, 0, 0.1025), 0.316, 0.205)
    b = unseen(
        "tyre_b",
        "Truck tyre that stands on its tread.",
        62,
        0.12,
        colours={"rubber": (0.085, 0.085, 0.085), "wall": (0.13, 0.125, 0.12)},
    )
    tyre(b, 0.52, 0.286, 0.31, lambda s: moved(s, (0, 0, 0.52), roll=math.pi / 2), 30)
    b.rolls = "y"
    b.friction = (0.9, 0.02, 0.02)
    b.collide_cylinder((0, 0, 0.52), 0.52, 0.29, "y")
    c = unseen(
        "tyre_c", "Wheel of a car with its rim, the tyre burst and half off.", 19, 0.2,
        colours={"rubber": (0.065, 0.065, 0.07), "wall": (0.10, 0.10, 0.10), "rim": (0.70, 0.71, 0.73)},
    )  # fmt: skip

    def torn(v):
        t = np.arctan2(v[:, 1], v[:, 0])
        off = np.exp(-((t - 0.6) ** 2) / 0.5)
        return v * np.stack([1 + 0.22 * off, 1 + 0.22 * off, 1 - 0.1 * off], 1) + np.stack(
            [0.10 * off, 0.05 * off, 0.10 * off], 1
        )

    tyre(c, 0.33, 0.216, 0.225, lambda s: bent(moved(s, (0, 0, 0.113)), torn), 28)
    c.add(
        "rim",
        lathe(
            [
                (0.205, 0.0),
                (0.225, 0.01),
                (0.20, 0.035),
                (0.19, 0.19),
                (0.225, 0.215),
                (0.215, 0.228),
                (0.18, 0.20),
                (0.175, 0.04),
                (0.205, 0.0),
            ],
            24,
        ),
    )
    for k in range(5):
        t = 2 * math.pi * k / 5
        arm = [
            (0.03 * math.cos(t), 0.03 * math.sin(t), 0.195),
            (0.11 * math.cos(t), 0.11 * math.sin(t), 0.205),
            (0.19 * math.cos(t), 0.19 * math.sin(t), 0.19),
        ]
        c.add("rim", sweep(arm, rounded_rectangle(0.06, 0.03, 0.008, 1)))
    c.add("rim", cylinder(0.06, 0.15, 0.215, 14))
    c.collide_hull(*c.everything())
    return [a, b, c]


def tyre(m: Model, radius: float, bore: float, width: float, place, n: int) -> None:
    """Side walls that bulge, an open bore, and a tread of blocks; axis z, middle at the origin."""
    w, r = width / 2, radius
    deep = r - bore
    wall = [(bore, -0.62 * w), (bore + 0.04 * r, -0.78 * w), (bore + 0.45 * deep, -w), (r - 0.14 * deep, -0.92 * w), (r - 0.05 * deep, -0.72 * w),
            (r - 0.05 * deep, 0.72 * w), (r - 0.14 * deep, 0.92 * w), (bore + 0.45 * deep, w), (bore + 0.04 * r, 0.78 * w), (bore, 0.62 * w),
            (bore + 0.35 * deep, 0.70 * w), (bore + 0.75 * deep, 0.5 * w), (bore + 0.75 * deep, -0.5 * w), (bore + 0.35 * deep, -0.70 * w)]  # fmt: skip
    turn = 2 * math.pi / n
    path = [(math.cos(turn * k) * r, math.sin(turn * k) * r, 0.0) for k in range(n)]
    m.add(
        "wall",
        place(sweep(path, ring_section(path, wall, r), closed=True)),
    )
    turn = 2 * math.pi / 22
    for row, y in enumerate((-0.36, 0.36)):
        for k in range(22):
            t = turn * (k + 0.5 * row)
            knob = block((r - 0.03 * deep, 0, y * w), (0.10 * deep, 0.66 * turn * r, 0.66 * w))
            m.add("rubber", place(moved(knob, yaw=t)))


def ring_section(path, wall, r: float) -> list[tuple[float, float]]:
    """The section of a ring in the frame that `sweep` makes along it: out is its first axis or against it."""
    side = frames(np.asarray(path, float), True)[0][0]
    sign = 1.0 if side[0] > 0 else -1.0
    return [(sign * (p - r), z) for p, z in wall]


def ladders() -> list[Model]:
    """An aluminium ladder on the ground, a step ladder that stands open, a wooden one that lies askew on its hooks."""
    a = unseen(
        "ladder_a",
        "Aluminium ladder, bent, lying.",
        9,
        0.6,
        colours={"rail": (0.72, 0.73, 0.75), "foot": (0.08, 0.08, 0.08)},
    )
    curve = lambda x: 0.05 + 0.16 * max(0.0, (x - 0.4) / 1.1) ** 2  # noqa: E731
    for s in (1, -1):
        path = [(x, s * 0.19, curve(x)) for x in np.linspace(-1.5, 1.5, 14)]
        a.add("rail", sweep(path, rounded_rectangle(0.028, 0.075, 0.008, 1)))
        a.add("foot", pillow((-1.51, s * 0.19, 0.05), (0.06, 0.045, 0.095), 3, 5))
    a.add(
        "rail",
        *(
            between((x, -0.18, curve(x)), (x, 0.18, curve(x)), 0.016, n=7)
            for x in np.linspace(-1.32, 1.36, 10)
        ),
    )
    a.collide_box((-0.55, 0, 0.05), (1.92, 0.41, 0.075))
    a.collide_box((0.72, 0, 0.07), (0.64, 0.41, 0.075), -0.09)
    a.collide_box((1.26, 0, 0.16), (0.50, 0.41, 0.075), -0.25)
    b = unseen(
        "ladder_b",
        "Step ladder with seven steps, standing open.",
        11,
        0.5,
        colours={
            "rail": (0.86, 0.46, 0.06),
            "step": (0.70, 0.71, 0.72),
            "foot": (0.08, 0.08, 0.08),
            "red": (0.75, 0.1, 0.08),
        },
    )
    top = 1.78
    for s in (1, -1):
        b.add(
            "rail",
            sweep(
                [(0.55, s * 0.27, 0.02), (0.24, s * 0.22, 0.95), (0.0, s * 0.18, top - 0.06)],
                rounded_rectangle(0.028, 0.07, 0.008, 1),
            ),
        )
        b.add(
            "rail",
            sweep(
                [(-0.55, s * 0.27, 0.02), (-0.28, s * 0.225, 0.9), (-0.05, s * 0.18, top - 0.08)],
                rounded_rectangle(0.025, 0.045, 0.006, 1),
            ),
        )
        b.add("foot", *(pillow((x, s * 0.27, 0.025), (0.085, 0.05, 0.05), 3, 4) for x in (0.555, -0.555)))
        b.add(
            "red",
            tube(
                [
                    (0.36, s * 0.235, 0.62, 0.006),
                    (0.0, s * 0.235, 0.52, 0.006),
                    (-0.36, s * 0.235, 0.60, 0.006),
                ],
                4,
                6,
            ),
        )
    for k in range(1, 7):
        t = k / 7
        b.add("step", block((0.55 - 0.55 * t, 0, top * t), (0.085, 0.53 - 0.16 * t, 0.025)))
        if k % 2:
            b.add(
                "rail",
                between(
                    (-0.55 + 0.5 * t, -0.26 + 0.08 * t, top * t),
                    (-0.55 + 0.5 * t, 0.26 - 0.08 * t, top * t),
                    0.011,
                    n=5,
                ),
            )
    b.add("foot", pillow((-0.02, 0, top - 0.01), (0.30, 0.42, 0.045), 4, 6))
    for s in (1, -1):
        b.collide_hull(
            block((s * 0.555, 0, 0.02), (0.07, 0.58, 0.04)),
            block((s * 0.02, 0, top - 0.02), (0.06, 0.38, 0.04)),
        )
    c = unseen(
        "ladder_c",
        "Wooden ladder with a broken rail and a rung out, lying tilted.",
        14,
        0.35,
        colours={"rail": (0.60, 0.44, 0.26), "rung": (0.70, 0.54, 0.33), "break": (0.84, 0.72, 0.50)},
    )
    place = lambda s: moved(s, (0, 0, 0.20), roll=0.75)  # noqa: E731
    rail = lambda y, low, high: sweep(
        [(x, y + 0.04 * math.sin(1.4 * x), 0.01 * math.sin(3 * x)) for x in np.linspace(low, high, 9)],
        rounded_rectangle(0.045, 0.06, 0.015, 1),
    )  # noqa: E731
    c.add(
        "rail",
        place(rail(0.23, -1.9, 1.9)),
        place(rail(-0.23, -1.9, 0.55)),
        place(moved(rail(-0.23, 0.65, 1.9), (0.02, 0.0, 0), yaw=-0.05)),
    )
    c.add(
        "break",
        *(
            place(
                between(
                    (0.52, -0.22 + d, 0.01 * k),
                    (0.66 + 0.03 * k, -0.215 + 1.6 * d, 0.02 - 0.015 * k),
                    0.012,
                    0.002,
                    4,
                )
            )
            for k, d in enumerate((-0.012, 0.0, 0.012))
        ),
    )
    for k, x in enumerate(np.linspace(-1.75, 1.75, 13)):
        if k == 8:
            continue
        c.add(
            "rung",
            place(
                tube(
                    [
                        (x, -0.23 + 0.04 * math.sin(1.4 * x), 0, 0.014),
                        (x, 0.04 * math.sin(1.4 * x), 0, 0.019),
                        (x, 0.23 + 0.04 * math.sin(1.4 * x), 0, 0.014),
                    ],
                    6,
                )
            ),
        )
    # The tread of a van's roof rack it still hangs in.
    for x in (-1.3, 1.3):
        bow = [
            (x, -0.10, 0.02, 0.014),
            (x, 0.17, 0.02, 0.014),
            (x, 0.22, 0.14, 0.014),
            (x, 0.19, 0.34, 0.014),
        ]
        c.add("steel", tube(bow, 6, 8))
    laid(c, -0.12)
    c.collide_hull(*c.parts["rail"])
    c.collide_hull(*c.parts["steel"])
    return [a, b, c]
