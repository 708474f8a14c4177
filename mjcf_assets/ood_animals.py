"""Animals on the road: how they are put together, and dogs and boars in three poses.

Only the test split shows them.
"""

from __future__ import annotations

import math

from kinds import unseen
from model_writer import Model
from organic import blend, chain, painted, tube
from solids import ball


def leg(*joints, flat: float = 0.8) -> list[tuple]:
    return chain(*joints, flat=flat)


def eyes(m: Model, x: float, y: float, z: float, r: float = 0.016) -> None:
    m.add("black", *(ball((x, s * y, z), (r, r, r), 6, 4) for s in (1, -1)))


def ears(m: Model, material: str, root, tip, wide: float, flat: float = 0.35) -> None:
    """Two leaves, each from a root to a tip on the left, and mirrored."""
    for s in (1, -1):
        (x0, y0, z0), (x1, y1, z1) = root, tip
        path = [
            (x0 + t * (x1 - x0), s * (y0 + t * (y1 - y0)), z0 + t * (z1 - z0), wide * w)
            for t, w in ((0, 0.7), (0.45, 1), (0.8, 0.6), (1, 0.2))
        ]
        m.add(material, tube(path, 6, wide=1 / flat if abs(y1 - y0) > abs(z1 - z0) else flat))


def animal(m: Model, trunk: list[tuple], legs: list[list[tuple]], cell_m: float, n: int, material_of) -> None:
    """One skin of n triangles in colours; collides as a trunk with its head, and each leg by itself."""
    body = blend([*trunk, *(limb for one in legs for limb in one)], cell_m, cell_m, n)
    for material, solids in painted(body, material_of).items():
        m.add(material, *solids)
    for part in (trunk, *legs):
        m.collide_hull(*(tube([a, b], 8) for a, b, _ in part))


def ring(n: int) -> list[float]:
    return [2 * math.pi * k / n for k in range(n)]


def dogs() -> list[Model]:
    return [shepherd(), sitting_dog(), great_dane()]


def shepherd() -> Model:
    """Standing, head up, one paw before the other; 0.65 m at the withers."""
    m = unseen(
        "dog_a", "Shepherd dog, standing.", 34, 0.35, fur=(0.52, 0.35, 0.18), saddle=(0.10, 0.08, 0.07)
    )
    trunk = [
        *chain(
            (-0.36, 0, 0.53, 0.125),
            (-0.10, 0, 0.53, 0.125),
            (0.16, 0, 0.52, 0.16),
            (0.26, 0, 0.54, 0.13),
            flat=0.8,
        ),
        *chain((0.24, 0, 0.58, 0.115), (0.42, 0, 0.78, 0.075)),
        *chain((0.44, 0, 0.82, 0.085), (0.52, 0, 0.81, 0.065), (0.655, 0, 0.775, 0.036)),
        *chain((-0.44, 0, 0.56, 0.045), (-0.56, 0, 0.42, 0.055), (-0.62, 0, 0.28, 0.045)),
    ]

    def fore(y, x):
        return leg(
            (0.20, y, 0.50, 0.08),
            (0.20 + x / 3, 1.1 * y, 0.30, 0.045),
            (0.20 + x, y, 0.05, 0.033),
            (0.25 + x, y, 0.035, 0.035),
        )

    def hind(y, x):
        return leg(
            (-0.34, y, 0.52, 0.11),
            (-0.26 + x / 3, 1.15 * y, 0.34, 0.065),
            (-0.42 + x, y, 0.20, 0.036),
            (-0.39 + x, y, 0.05, 0.03),
            (-0.34 + x, y, 0.035, 0.034),
        )

    legs = [fore(0.09, 0.08), fore(-0.09, -0.06), hind(0.09, -0.10), hind(-0.09, 0.06)]

    def saddled(x, y, z):
        return (-0.44 < x < 0.24 and z > 0.53 + 0.04 * math.sin(9 * x)) or x > 0.57

    animal(m, trunk, legs, 0.022, 1100, lambda *p: "saddle" if saddled(*p) else "fur")
    ears(m, "saddle", (0.43, 0.055, 0.86), (0.44, 0.075, 0.99), 0.035)
    m.collide_hull(*m.parts["saddle"][-2:])
    eyes(m, 0.545, 0.055, 0.845)
    m.add("black", ball((0.69, 0, 0.785), (0.022, 0.025, 0.02), 8, 5))
    m.add("tongue", ball((0.62, 0, 0.735), (0.05, 0.022, 0.012), 8, 4))
    m.colours["tongue"] = (0.70, 0.30, 0.32)
    return m


def sitting_dog() -> Model:
    """A retriever on its haunches."""
    m = unseen("dog_b", "Retriever, sitting.", 31, 0.45, fur=(0.76, 0.60, 0.36), pale=(0.86, 0.76, 0.56))
    trunk = [
        *chain(
            (-0.22, 0, 0.17, 0.14),
            (-0.06, 0, 0.34, 0.14),
            (0.08, 0, 0.50, 0.14),
            (0.12, 0, 0.56, 0.12),
            flat=0.85,
        ),
        *chain((0.10, 0, 0.60, 0.11), (0.17, 0, 0.75, 0.085)),
        *chain((0.18, 0, 0.80, 0.09), (0.27, 0, 0.79, 0.07), (0.38, 0, 0.76, 0.045)),
        *chain((-0.30, 0, 0.08, 0.05), (-0.48, 0.06, 0.05, 0.045), (-0.60, 0.18, 0.045, 0.035)),
    ]
    fore = [
        leg((0.12, y, 0.45, 0.075), (0.15, y, 0.25, 0.048), (0.17, y, 0.05, 0.038), (0.23, y, 0.035, 0.038))
        for y in (0.10, -0.10)
    ]
    hind = [
        leg(
            (-0.20, y, 0.18, 0.12),
            (-0.02, 1.25 * y, 0.20, 0.085),
            (-0.12, 1.3 * y, 0.06, 0.05),
            (0.08, 1.35 * y, 0.04, 0.04),
        )
        for y in (0.13, -0.13)
    ]
    animal(
        m,
        trunk,
        [*fore, *hind],
        0.022,
        1100,
        lambda x, y, z: "pale" if x > 0.1 and z < 0.62 and z > 0.3 and x > 0.75 - z else "fur",
    )
    for s in (1, -1):
        flap = [(0.17, s * 0.075, 0.86, 0.03), (0.19, s * 0.105, 0.80, 0.045), (0.20, s * 0.11, 0.72, 0.035)]
        m.add("fur", tube(flap, 6, wide=0.5))
    eyes(m, 0.295, 0.05, 0.83)
    m.add("black", ball((0.42, 0, 0.775), (0.022, 0.026, 0.02), 8, 5))
    m.add("tongue", ball((0.37, 0, 0.705), (0.035, 0.022, 0.03), 8, 4))
    m.add(
        "collar",
        tube(
            [
                (0.145 + 0.105 * math.cos(t), 0.105 * math.sin(t), 0.66 - 0.05 * math.cos(t), 0.014)
                for t in ring(12)
            ],
            5,
            closed=True,
        ),
    )
    m.colours |= {"tongue": (0.74, 0.36, 0.38), "collar": (0.65, 0.08, 0.08)}
    return m


def great_dane() -> Model:
    """Nose on the ground, white with black patches; 0.82 m at the withers."""
    m = unseen(
        "dog_c",
        "Great dane, white with black patches, sniffing at the ground.",
        62,
        0.55,
        fur=(0.86, 0.85, 0.82),
        patch=(0.07, 0.07, 0.08),
    )
    trunk = [
        *chain(
            (-0.42, 0, 0.67, 0.135),
            (-0.12, 0, 0.65, 0.125),
            (0.18, 0, 0.62, 0.175),
            (0.32, 0, 0.64, 0.14),
            flat=0.75,
        ),
        *chain((0.34, 0, 0.64, 0.12), (0.56, 0, 0.46, 0.08), (0.66, 0, 0.34, 0.075)),
        *chain((0.66, 0, 0.32, 0.085), (0.74, 0, 0.23, 0.065), (0.81, 0, 0.11, 0.048)),
        *chain((-0.52, 0, 0.70, 0.04), (-0.68, 0, 0.62, 0.03), (-0.78, 0, 0.66, 0.024)),
    ]

    def fore(y, x):
        return leg(
            (0.24, y, 0.60, 0.095),
            (0.26 + x / 3, 1.1 * y, 0.36, 0.05),
            (0.26 + x, y, 0.06, 0.036),
            (0.32 + x, y, 0.04, 0.042),
        )

    def hind(y, x):
        return leg(
            (-0.42, y, 0.64, 0.12),
            (-0.33 + x / 3, 1.15 * y, 0.42, 0.07),
            (-0.50 + x, y, 0.26, 0.042),
            (-0.46 + x, y, 0.06, 0.034),
            (-0.40 + x, y, 0.04, 0.04),
        )

    spots = (
        (0.10, 0.12, 0.70, 0.17),
        (-0.35, -0.1, 0.72, 0.17),
        (-0.3, 0.1, 0.52, 0.12),
        (0.68, 0.04, 0.33, 0.10),
        (0.25, -0.1, 0.45, 0.12),
    )

    def spotted(x, y, z):
        return any(math.dist((x, y, z), s[:3]) < s[3] for s in spots)

    legs = [fore(0.10, 0.02), fore(-0.10, 0.16), hind(0.10, 0.08), hind(-0.10, -0.12)]
    animal(m, trunk, legs, 0.024, 1200, lambda *p: "patch" if spotted(*p) else "fur")
    for s in (1, -1):
        flap = [(0.61, s * 0.06, 0.40, 0.025), (0.63, s * 0.10, 0.33, 0.04), (0.64, s * 0.105, 0.25, 0.03)]
        m.add("patch", tube(flap, 6, wide=0.5))
    eyes(m, 0.76, 0.05, 0.27)
    m.add("black", ball((0.845, 0, 0.085), (0.025, 0.03, 0.024), 8, 5))
    return m


def boars() -> list[Model]:
    return [
        boar("a", "Wild boar, a tusked male.", 110, 1.0, (0.16, 0.13, 0.11), 0.09),
        boar("b", "Wild sow, rooting.", 70, 0.84, (0.34, 0.27, 0.20), 0.0),
        boar(
            "c",
            "Young wild boar, running, with the stripes of its first year.",
            32,
            0.6,
            (0.46, 0.30, 0.16),
            0.2,
        ),
    ]


def boar(tag: str, about: str, mass_kg: float, scale: float, coat, stride: float) -> Model:
    """High shoulders, a long head held low, short legs; 0.95 m at the withers by the scale."""
    m = unseen(
        f"boar_{tag}",
        about,
        mass_kg,
        0.3,
        coat=coat,
        bristle=tuple(0.55 * c for c in coat),
        snout=(0.40, 0.28, 0.25),
    )
    k = scale
    low = 0.16 if tag == "b" else 0.0

    def limb(*joints, flat=0.75):
        return chain(*(tuple(k * c for c in j) for j in joints), flat=flat)

    trunk = [
        *limb(
            (-0.52, 0, 0.58, 0.20),
            (-0.15, 0, 0.58, 0.25),
            (0.22, 0, 0.62, 0.27),
            (0.34, 0, 0.62, 0.23),
            flat=0.72,
        ),
        *limb((0.36, 0, 0.62, 0.215), (0.56, 0, 0.55 - low / 2, 0.175)),
        *limb((0.58, 0, 0.56 - low / 2, 0.165), (0.72, 0, 0.47 - low, 0.12), (0.88, 0, 0.37 - low, 0.082)),
        *limb((-0.70, 0, 0.62, 0.03), (-0.76, 0, 0.48, 0.028), (-0.77, 0, 0.36, 0.03)),
    ]
    legs = []
    for s in (1, -1):
        x = s * stride
        legs.append(
            limb(
                (0.28, s * 0.13, 0.50, 0.13),
                (0.30 + x / 2, s * 0.14, 0.27, 0.06),
                (0.28 + x, s * 0.13, 0.05, 0.036),
                (0.31 + x, s * 0.13, 0.035, 0.04),
            )
        )
        legs.append(
            limb(
                (-0.48, s * 0.13, 0.52, 0.15),
                (-0.42 - x / 3, s * 0.14, 0.32, 0.075),
                (-0.52 - x, s * 0.13, 0.20, 0.045),
                (-0.48 - x, s * 0.13, 0.04, 0.038),
            )
        )

    def tint(x, y, z):
        x, y, z = x / k, y / k, z / k
        if x > 0.94:
            return "snout"
        if tag == "c" and -0.6 < x < 0.5 and 0.5 < z < 0.82:
            return "bristle" if math.sin(48 * z + 3 * x) > 0.1 else "coat"
        return "bristle" if (z > 0.80 and abs(y) < 0.1 and x > -0.4) or z < 0.16 else "coat"

    animal(m, trunk, legs, 0.034 * k, 1200, tint)
    tilt = low
    ears(
        m,
        "bristle",
        (k * 0.54, k * 0.11, k * (0.68 - tilt / 2)),
        (k * 0.50, k * 0.17, k * (0.88 - tilt / 2)),
        0.055 * k,
    )
    eyes(m, k * 0.70, k * 0.10, k * (0.56 - tilt), 0.022 * k)
    m.add("snout", ball((k * 0.955, 0, k * (0.34 - low)), (0.025 * k, 0.068 * k, 0.062 * k), 10, 6))
    if tag == "a":
        for s in (1, -1):
            m.add(
                "white",
                tube(
                    [
                        (0.80, s * 0.06, 0.33, 0.02),
                        (0.85, s * 0.11, 0.36, 0.017),
                        (0.85, s * 0.12, 0.45, 0.006),
                    ],
                    5,
                    5,
                ),
            )
    if tag != "c":
        crest = [
            (x, 0, z, r)
            for x, z, r in ((-0.30, 0.80, 0.02), (0.0, 0.86, 0.05), (0.25, 0.90, 0.06), (0.45, 0.80, 0.03))
        ]
        m.add("bristle", tube([tuple(k * c for c in p) for p in crest], 6, 8, wide=0.45))
    return m
