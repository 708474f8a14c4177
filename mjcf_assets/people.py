"""Walking people: parts by material, facing +x."""

from __future__ import annotations

import math

import numpy as np
from model_writer import Model
from solids import ball, between, box, lathe, loft, moved


def body(m: Model, height: float, stride: float, top: str, legs: str, hip_scale: float = 1.0) -> None:
    """A walking figure of the given height; stride is the half angle of the legs."""
    h = height
    hip, shoulder, neck = 0.52 * h, 0.81 * h, 0.845 * h
    leg, arm = 0.25 * h, 0.17 * h
    for side in (1, -1):
        y, swing = side * 0.052 * h, side * stride
        knee = (leg * math.sin(swing), y, hip - leg * math.cos(swing))
        bend = swing - (0.35 if swing < 0 else 0.05) * min(1.0, stride / 0.3)
        ankle = (knee[0] + leg * math.sin(bend), y, knee[2] - leg * math.cos(bend) + 0.012 * h)
        m.add(
            legs,
            between((0, y, hip), knee, 0.050 * h * hip_scale, 0.038 * h, rounded=True),
            between(knee, ankle, 0.037 * h, 0.027 * h, rounded=True),
        )
        m.add("shoe", box((ankle[0] + 0.035 * h, y, ankle[2] - 0.022 * h), (0.145 * h, 0.052 * h, 0.045 * h)))
        elbow = (-arm * math.sin(swing * 0.9), side * 0.145 * h, shoulder - arm * math.cos(swing * 0.9))
        hand = (
            elbow[0] + 0.15 * h * math.sin(0.4 - swing * 0.8),
            side * 0.135 * h,
            elbow[2] - 0.15 * h * math.cos(0.4 - swing * 0.8),
        )
        m.add(
            top,
            between((0, side * 0.115 * h, shoulder - 0.01 * h), elbow, 0.034 * h, 0.027 * h, rounded=True),
            between(elbow, hand, 0.026 * h, 0.02 * h, rounded=True),
        )
        m.add("skin", ball(hand, (0.027 * h, 0.02 * h, 0.035 * h), 8, 5))
    torso(m, top, (0, 0, hip - 0.02 * h), (0, 0, neck), h)
    m.add(
        "skin",
        between((0, 0, neck - 0.02 * h), (0.01 * h, 0, neck + 0.05 * h), 0.032 * h, n=8),
        ball((0.012 * h, 0, 0.925 * h), (0.058 * h, 0.047 * h, 0.070 * h)),
    )
    m.add("hair", ball((-0.006 * h, 0, 0.944 * h), (0.056 * h, 0.053 * h, 0.056 * h)))


def torso(m: Model, material: str, low, high, h: float) -> None:
    rows = []
    for t, rx, ry in (
        (0, 0.055, 0.088),
        (0.3, 0.058, 0.085),
        (0.7, 0.070, 0.112),
        (0.9, 0.055, 0.110),
        (1, 0.03, 0.05),
    ):
        c = [low[k] + t * (high[k] - low[k]) for k in range(3)]
        rows.append(
            [
                (c[0] + rx * h * math.cos(a), c[1] + ry * h * math.sin(a), c[2])
                for a in (2 * math.pi * k / 12 for k in range(12))
            ]
        )
    m.add(material, loft(rows, smooth=True))


def skirt(m: Model, material: str, rings) -> None:
    """An elliptic cone round the hips: (radius, height) from the hem up."""
    m.add(
        material,
        loft(
            [
                [
                    (r * math.cos(t), 1.08 * r * math.sin(t), z)
                    for t in (2 * math.pi * k / 14 for k in range(14))
                ]
                for r, z in rings
            ],
            smooth=True,
        ),
    )


def pedestrians() -> list[Model]:
    a = Model(
        "adult_a",
        "adult",
        "pedestrian",
        "Walking adult in trousers, with a backpack.",
        78,
        0.3,
        paint="clothes",
        colours={"clothes": (0.20, 0.32, 0.52), "trousers": (0.14, 0.15, 0.19), "bag": (0.32, 0.10, 0.09)},
    )
    body(a, 1.78, 0.42, "clothes", "trousers")
    a.add("bag", box((-0.19, 0, 1.27), (0.17, 0.30, 0.42)))
    b = Model(
        "adult_b",
        "adult",
        "pedestrian",
        "Walking adult in a long coat.",
        64,
        0.3,
        paint="clothes",
        colours={"clothes": (0.55, 0.16, 0.20), "trousers": (0.22, 0.20, 0.22), "hair": (0.38, 0.24, 0.12)},
    )
    body(b, 1.66, 0.34, "clothes", "trousers")
    b.add(
        "clothes",
        moved(
            loft(
                [
                    [
                        (r * math.cos(t), 0.8 * r * math.sin(t) * 1.35, z)
                        for t in (2 * math.pi * k / 12 for k in range(12))
                    ]
                    for r, z in ((0.22, 0.60), (0.13, 0.98))
                ],
                smooth=True,
            )
        ),
    )
    b.add("hair", ball((-0.05, 0, 1.47), (0.06, 0.09, 0.14)))
    c = Model(
        "child",
        "child",
        "pedestrian",
        "Walking child.",
        26,
        0.3,
        paint="clothes",
        colours={"clothes": (0.90, 0.62, 0.12), "trousers": (0.18, 0.26, 0.42)},
    )
    body(c, 1.22, 0.38, "clothes", "trousers", 1.1)
    c.add("skin", ball((0.01, 0, 1.125), (0.085, 0.075, 0.095)))
    c.add("hair", ball((-0.012, 0, 1.15), (0.085, 0.082, 0.08)))
    d = Model(
        "adult_c",
        "adult",
        "pedestrian",
        "Walking adult in a wide skirt, with a shoulder bag and long hair.",
        61,
        0.3,
        paint="clothes",
        colours={
            "clothes": (0.86, 0.84, 0.78),
            "skirt": (0.16, 0.24, 0.44),
            "bag": (0.45, 0.28, 0.14),
            "hair": (0.50, 0.34, 0.16),
        },
    )
    body(d, 1.70, 0.30, "clothes", "skin")
    skirt(d, "skirt", ((0.27, 0.56), (0.15, 0.97), (0.13, 1.06)))
    d.add("hair", ball((-0.06, 0, 1.50), (0.06, 0.095, 0.17)))
    d.add("bag", box((-0.02, -0.30, 0.93), (0.30, 0.10, 0.24)))
    d.add("bag", between((-0.02, -0.29, 1.04), (0.0, -0.13, 1.41), 0.014, n=5))
    e = Model(
        "adult_d",
        "adult",
        "pedestrian",
        "Stout old walker with a hat and a stick.",
        92,
        0.3,
        paint="clothes",
        colours={
            "clothes": (0.36, 0.34, 0.26),
            "trousers": (0.34, 0.31, 0.28),
            "hat": (0.20, 0.17, 0.14),
            "hair": (0.72, 0.72, 0.70),
        },
    )
    body(e, 1.72, 0.24, "clothes", "trousers", 1.15)
    e.add("clothes", ball((0.035, 0, 1.06), (0.19, 0.205, 0.27), 12, 8))
    e.add(
        "hat", lathe([(0, 1.665), (0.155, 1.665), (0.155, 1.685), (0.10, 1.69), (0.085, 1.78), (0, 1.79)], 14)
    )
    e.add("wood", between((0.30, -0.25, 0.0), (0.20, -0.24, 0.86), 0.014, n=6))
    f = Model(
        "child_b",
        "child",
        "pedestrian",
        "Older child with a school bag and a cap, walking fast.",
        44,
        0.3,
        paint="clothes",
        colours={
            "clothes": (0.20, 0.50, 0.46),
            "trousers": (0.42, 0.38, 0.30),
            "bag": (0.85, 0.42, 0.08),
            "cap": (0.70, 0.10, 0.10),
        },
    )
    body(f, 1.48, 0.50, "clothes", "trousers")
    f.add("bag", box((-0.19, 0, 1.08), (0.20, 0.32, 0.40)))
    f.add("cap", ball((0.0, 0, 1.405), (0.098, 0.088, 0.085)), box((0.12, 0, 1.41), (0.12, 0.13, 0.018)))
    models = [a, b, c, d, e, f]
    for model in models:
        model.damping = 1.0
        corners = np.concatenate([v for v, _ in model.everything()])
        low, high = corners.min(0), corners.max(0)
        # On one foot nobody stands without muscles: a sole between the feet.
        sole = box(
            (*(low + high)[:2] / 2, low[2] + 0.01), (0.6 * (high - low)[0], 0.5 * (high - low)[1], 0.02)
        )
        model.collide_hull(*model.everything(), sole)
    return models
