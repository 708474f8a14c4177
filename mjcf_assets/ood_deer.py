"""Deer in three shapes: a roe doe, a stag with antlers, a fallow deer that grazes.

Only the test split shows them.
"""

from __future__ import annotations

import math

from kinds import unseen
from model_writer import Model
from ood_animals import animal, ears, eyes, leg
from organic import chain, tube
from solids import Solid, ball


def deer() -> list[Model]:
    return [roe(), stag(), fawn()]


def slender_legs(
    x_fore: float, x_hind: float, y: float, z: float, r: float, stride: float
) -> list[list[tuple]]:
    """Four thin legs with hooves under a trunk at height z; r is of the shin."""
    out = []
    for s, step in ((1, stride), (-1, -stride)):
        x = x_fore + step
        out.append(
            leg(
                (x_fore, s * y, z, 3.4 * r),
                (x_fore + step / 2 + 0.02, s * y, 0.52 * z, 1.6 * r),
                (x, s * y, 0.09 * z, r),
                (x + 0.03, s * y, 0.02, 1.3 * r),
            )
        )
        x = x_hind - step
        out.append(
            leg(
                (x_hind, s * y, z, 4.4 * r),
                (x_hind + 0.06 - step / 3, s * y, 0.66 * z, 2.4 * r),
                (x - 0.07, s * y, 0.44 * z, 1.25 * r),
                (x, s * y, 0.09 * z, r),
                (x + 0.03, s * y, 0.02, 1.3 * r),
            )
        )
    return out


def head(m: Model, ear: tuple, eye: tuple, nose: Solid) -> None:
    """Ears, eyes and nose, with the arguments of `ears`, `eyes`."""
    ears(m, "coat", *ear)
    eyes(m, *eye)
    m.add("black", nose)


def roe() -> Model:
    """A roe doe that looks up; 0.72 m at the withers."""
    m = unseen(
        "deer_a",
        "Roe deer, a doe that looks up.",
        26,
        0.4,
        coat=(0.48, 0.29, 0.15),
        rump=(0.90, 0.86, 0.78),
        hoof=(0.10, 0.08, 0.07),
    )
    trunk = [
        *chain(
            (-0.34, 0, 0.62, 0.135),
            (-0.08, 0, 0.59, 0.145),
            (0.18, 0, 0.60, 0.14),
            (0.28, 0, 0.62, 0.11),
            flat=0.8,
        ),
        *chain((0.28, 0, 0.64, 0.10), (0.37, 0, 0.82, 0.062), (0.42, 0, 0.96, 0.055)),
        *chain((0.42, 0, 1.00, 0.066), (0.50, 0, 0.985, 0.052), (0.62, 0, 0.94, 0.034)),
    ]
    legs = slender_legs(0.22, -0.33, 0.075, 0.52, 0.022, 0.07)

    def tint(x, y, z):
        return "hoof" if z < 0.035 else "rump" if x < -0.42 and z > 0.5 else "coat"

    animal(m, trunk, legs, 0.02, 1100, tint)
    nose = ball((0.65, 0, 0.945), (0.02, 0.024, 0.022), 8, 5)
    head(m, ((0.41, 0.05, 1.03), (0.37, 0.15, 1.14), 0.038), (0.505, 0.045, 1.01, 0.018), nose)
    m.collide_hull(*m.parts["coat"][-2:])
    return m


def stag() -> Model:
    """A red deer with antlers of ten points, walking; 1.2 m at the withers."""
    m = unseen(
        "deer_b",
        "Red deer, a stag with antlers.",
        160,
        0.35,
        coat=(0.36, 0.21, 0.12),
        mane=(0.22, 0.14, 0.09),
        rump=(0.72, 0.58, 0.38),
        hoof=(0.08, 0.07, 0.06),
        antler=(0.62, 0.50, 0.36),
    )
    trunk = [
        *chain(
            (-0.62, 0, 1.02, 0.21),
            (-0.20, 0, 0.98, 0.22),
            (0.28, 0, 0.98, 0.245),
            (0.48, 0, 1.03, 0.20),
            flat=0.75,
        ),
        *chain((0.46, 0, 1.06, 0.18), (0.66, 0, 1.30, 0.13), (0.76, 0, 1.46, 0.095)),
        *chain((0.76, 0, 1.52, 0.10), (0.90, 0, 1.48, 0.08), (1.08, 0, 1.40, 0.052)),
        *chain((-0.80, 0, 1.06, 0.05), (-0.86, 0, 0.94, 0.04)),
    ]
    legs = slender_legs(0.36, -0.58, 0.13, 0.88, 0.034, 0.14)

    def tint(x, y, z):
        if z < 0.06:
            return "hoof"
        if x < -0.74 and z > 0.85:
            return "rump"
        return "mane" if 0.40 < x < 0.80 and z > 0.95 and z > 1.9 - 1.2 * x else "coat"

    animal(m, trunk, legs, 0.032, 1200, tint)
    nose = ball((1.12, 0, 1.41), (0.03, 0.04, 0.036), 8, 5)
    head(m, ((0.72, 0.08, 1.55), (0.64, 0.26, 1.62), 0.05), (0.89, 0.075, 1.52, 0.022), nose)
    for s in (1, -1):
        beam = [(0.74, 0.06, 1.60), (0.60, 0.22, 1.80), (0.56, 0.38, 2.02), (0.66, 0.44, 2.22)]
        tines = (
            ((0.72, 0.09, 1.65), (0.86, 0.15, 1.70), (0.96, 0.17, 1.82)),
            ((0.59, 0.26, 1.86), (0.74, 0.32, 1.90), (0.84, 0.33, 2.00)),
            ((0.57, 0.39, 2.05), (0.50, 0.50, 2.14), (0.48, 0.54, 2.26)),
            ((0.60, 0.41, 2.12), (0.74, 0.48, 2.16), (0.80, 0.50, 2.24)),
        )
        m.add("antler", tube([(x, s * y, z, 0.026 - 0.005 * k) for k, (x, y, z) in enumerate(beam)], 6, 10))
        m.add(
            "antler",
            *(tube([(x, s * y, z, 0.017 - 0.005 * k) for k, (x, y, z) in enumerate(t)], 5, 5) for t in tines),
        )
    m.collide_hull(*m.parts["antler"])
    return m


def fawn() -> Model:
    """A spotted fallow deer that grazes."""
    m = unseen(
        "deer_c",
        "Fallow deer with white spots, grazing.",
        45,
        0.4,
        coat=(0.56, 0.34, 0.17),
        spot=(0.88, 0.80, 0.68),
        hoof=(0.10, 0.08, 0.07),
    )
    trunk = [
        *chain(
            (-0.46, 0, 0.76, 0.155),
            (-0.14, 0, 0.72, 0.16),
            (0.20, 0, 0.72, 0.165),
            (0.32, 0, 0.72, 0.13),
            flat=0.78,
        ),
        *chain((0.32, 0, 0.72, 0.115), (0.52, 0, 0.50, 0.07), (0.64, 0, 0.32, 0.058)),
        *chain((0.65, 0, 0.28, 0.07), (0.70, 0, 0.20, 0.055), (0.75, 0, 0.07, 0.036)),
        *chain((-0.58, 0, 0.78, 0.04), (-0.63, 0, 0.64, 0.03)),
    ]
    legs = slender_legs(0.26, -0.44, 0.09, 0.64, 0.025, 0.05)

    def tint(x, y, z):
        if z < 0.045:
            return "hoof"
        is_flank = -0.55 < x < 0.3 and 0.62 < z < 0.86
        return (
            "spot"
            if (is_flank and math.sin(29 * x) * math.sin(37 * z + 14 * x) > 0.45)
            or (z < 0.6 < z + 0.25 * (abs(x) < 0.3) and abs(y) < 0.06)
            else "coat"
        )

    animal(m, trunk, legs, 0.022, 1500, tint)
    nose = ball((0.76, 0, 0.045), (0.022, 0.026, 0.022), 8, 5)
    head(m, ((0.61, 0.055, 0.32), (0.56, 0.18, 0.34), 0.04), (0.71, 0.05, 0.24, 0.018), nose)
    m.collide_hull(*m.parts["coat"][-2:])
    return m
