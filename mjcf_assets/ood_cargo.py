"""Lost cargo, each in three shapes: pallets and ladders.

Only the test split shows them.
"""

from __future__ import annotations

import math

import numpy as np
from kinds import unseen
from model_writer import Model
from organic import block, laid, pillow, rough, rounded_rectangle, sweep, tube
from solids import between, moved


def pallets() -> list[Model]:
    """A Euro pallet (EN 13698: 1.2 x 0.8 x 0.144 m) with a broken board, one upside down, three askew."""
    a = unseen("pallet_a", "Euro pallet with a broken and a missing board.", 23, 0.35, **WOOD)
    pallet(a, 1.2, 0.8, lambda s: s, missing=(1,), broken=(3,))
    a.collide_box((0, 0, 0.072), (1.2, 0.8, 0.144))
    blue = {"board": (0.10, 0.24, 0.55), "block": (0.08, 0.18, 0.42), "break": (0.74, 0.60, 0.40)}
    b = unseen("pallet_b", "Blue pallet upside down, one corner up on a splintered block.", 27, 0.4, **blue)
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
        **{"board": (0.46, 0.41, 0.35), "block": (0.37, 0.33, 0.28), "break": (0.62, 0.52, 0.38)},
    )
    for k, (yaw, x, y) in enumerate(((0.0, 0, 0), (0.3, 0.10, -0.05), (-0.12, -0.08, 0.12))):
        tilt = 0.09 if k == 2 else 0.0

        def place(s, k=k, yaw=yaw, x=x, y=y, tilt=tilt):
            return moved(s, (x, y, 0.146 * k + 4.5 * tilt * 0.144 * 0.7), yaw=yaw, roll=tilt)

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


def ladders() -> list[Model]:
    """A bent one of aluminium, a step ladder that stands open, a wooden one that lies on its hooks."""
    a = unseen(
        "ladder_a", "Aluminium ladder, bent, lying.", 9, 0.6, rail=(0.72, 0.73, 0.75), foot=(0.08, 0.08, 0.08)
    )

    def curve(x):
        return 0.05 + 0.16 * max(0.0, (x - 0.4) / 1.1) ** 2

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
        rail=(0.86, 0.46, 0.06),
        step=(0.70, 0.71, 0.72),
        foot=(0.08, 0.08, 0.08),
        red=(0.75, 0.1, 0.08),
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
        **{"rail": (0.60, 0.44, 0.26), "rung": (0.70, 0.54, 0.33), "break": (0.84, 0.72, 0.50)},
    )

    def place(s):
        return moved(s, (0, 0, 0.20), roll=0.75)

    def rail(y, low, high):
        return sweep(
            [(x, y + 0.04 * math.sin(1.4 * x), 0.01 * math.sin(3 * x)) for x in np.linspace(low, high, 9)],
            rounded_rectangle(0.045, 0.06, 0.015, 1),
        )

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
    # The hooks of the roof that it hung on.
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
