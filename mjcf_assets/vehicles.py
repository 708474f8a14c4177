"""Cars, van, truck and bus: parts by material, facing +x."""

from __future__ import annotations

import math

from model_writer import Model
from solids import Solid, between, box, extrude_y, frustum, loft, wheel


def arch(x: float, radius: float, sill: float) -> list[tuple[float, float]]:
    """A wheel arch in a side view, front to back, cut from the sill line."""
    angle = math.asin(min(1.0, sill / radius) * 0.5)
    steps = [angle + (math.pi - 2 * angle) * k / 6 for k in range(7)]
    return [(x + radius * math.cos(a), max(sill, radius * 0.95 * math.sin(a) + sill * 0.6)) for a in steps]


def shell(profile, width: float, shoulder: float = 0.05) -> Solid:
    """A side view swept across y, drawn in at the flanks so that the edges catch the light."""
    xs, zs = [p[0] for p in profile], [p[1] for p in profile]
    mid_x, mid_z = (min(xs) + max(xs)) / 2, min(zs) + 0.35 * (max(zs) - min(zs))
    inner = [
        (mid_x + (x - mid_x) * 0.985, z if z < mid_z else mid_z + (z - mid_z) * 0.90) for x, z in profile
    ]
    half = width / 2
    rows = [(-half, inner), (-half + shoulder, profile), (half - shoulder, profile), (half, inner)]
    return loft([[(x, y, z) for x, z in row] for y, row in rows])


def wheels(model: Model, axles, half_track: float, radius: float, width: float) -> None:
    for x in axles:
        for y in (half_track, -half_track):
            tyre, rim = wheel(x, y, radius, width)
            model.add("tyre", tyre)
            model.add("rim", rim)


def greenhouse(model: Model, base, roof, pillar_x: float) -> None:
    """Glass cabin between two rectangles, with a painted roof and pillars."""
    model.add("glass", frustum(base, roof))
    (a, b, c, d, z0), (e, f, g, h, z1) = base, roof
    model.add("paint", frustum((e, f, g, h, z1 - 0.03), (e + 0.08, f - 0.08, g + 0.06, h - 0.06, z1 + 0.04)))
    for (x0, y0), (x1, y1) in (
        ((a, c), (e, g)),
        ((a, d), (e, h)),
        ((b, c), (f, g)),
        ((b, d), (f, h)),
        ((pillar_x, c), (pillar_x - 0.05, g)),
        ((pillar_x, d), (pillar_x - 0.05, h)),
    ):
        model.add("paint", between((x0, y0, z0), (x1, y1, z1), 0.045, 0.04, n=6))


def lamps(model: Model, front: float, rear: float, y: float, z_front: float, z_rear: float) -> None:
    for side in (1, -1):
        model.add("headlamp", box((front, side * y, z_front), (0.10, 0.34, 0.13)))
        model.add("taillamp", box((rear, side * y, z_rear), (0.08, 0.30, 0.15)))
    model.add(
        "plate",
        box((front + 0.03, 0, z_front - 0.24), (0.03, 0.5, 0.11)),
        box((rear - 0.02, 0, z_rear - 0.12), (0.03, 0.5, 0.11)),
    )


def mirrors(model: Model, x: float, y: float, z: float, tall: float = 0.14) -> None:
    for side in (1, -1):
        model.add("trim", box((x, side * y, z), (0.12, 0.18, tall)))


def car(name: str, category: str, about: str, paint, hatch: bool) -> Model:
    m = Model(
        name,
        category,
        "vehicle",
        about,
        1250 if hatch else 1450,
        0.35,
        paint="paint",
        colours={"paint": paint},
    )
    half, front, rear = (2.02, 1.30, -1.24) if hatch else (2.30, 1.42, -1.36)
    width = 1.76 if hatch else 1.82
    nose = [(half, 0.34), (half, 0.60), (half - 0.10, 0.74), (front - 0.42, 0.93)]
    tail = (
        [(-half + 0.08, 0.97), (-half, 0.70), (-half, 0.34)]
        if hatch
        else [(-half + 0.55, 0.98), (-half + 0.06, 0.96), (-half, 0.72), (-half, 0.34)]
    )
    under = [
        (-half + 0.1, 0.22),
        *arch(rear, 0.38, 0.22)[::-1],
        *arch(front, 0.38, 0.22)[::-1],
        (half - 0.1, 0.22),
    ]
    m.add("paint", shell([*nose, *tail, *under], width))
    m.add(
        "trim",
        box((0, 0, 0.32), (2 * half - 0.5, width - 0.45, 0.24)),
        box((half - 0.01, 0, 0.42), (0.06, width - 0.5, 0.14)),
        box((-half + 0.01, 0, 0.40), (0.06, width - 0.4, 0.12)),
    )
    y0, y1 = width / 2 - 0.06, width / 2 - 0.24
    if hatch:
        greenhouse(
            m, (-half + 0.10, front - 0.42, -y0, y0, 0.90), (-half + 0.42, front - 1.18, -y1, y1, 1.44), -0.12
        )
    else:
        greenhouse(
            m, (-half + 0.60, front - 0.44, -y0, y0, 0.91), (-half + 1.22, front - 1.22, -y1, y1, 1.40), -0.25
        )
    lamps(m, half - 0.05, -half + 0.03, width / 2 - 0.24, 0.66, 0.80)
    wheels(m, (front, rear), width / 2 - 0.12, 0.32, 0.21)
    m.collide_hull(m.parts["paint"][0], *m.parts["tyre"])
    m.collide_hull(m.parts["glass"][0], m.parts["paint"][1])
    mirrors(m, front - 0.62, width / 2 + 0.04, 0.98)
    return m


def van() -> Model:
    m = Model(
        "van",
        "van",
        "vehicle",
        "Panel van.",
        2200,
        0.45,
        paint="paint",
        colours={"paint": (0.90, 0.90, 0.88)},
    )
    side = [
        (2.70, 0.38),
        (2.70, 0.95),
        (2.52, 1.12),
        (1.98, 1.30),
        (1.38, 2.16),
        (1.10, 2.34),
        (-2.60, 2.36),
        (-2.70, 2.2),
        (-2.70, 0.38),
        (-2.6, 0.26),
        *arch(-1.72, 0.42, 0.26)[::-1],
        *arch(1.72, 0.42, 0.26)[::-1],
        (2.6, 0.26),
    ]
    m.add("paint", shell(side, 1.98, 0.10))
    m.add(
        "glass",
        loft(
            [
                [(1.99, -0.86, 1.33), (2.03, -0.86, 1.33), (1.47, -0.78, 2.12), (1.43, -0.78, 2.12)],
                [(1.99, 0.86, 1.33), (2.03, 0.86, 1.33), (1.47, 0.78, 2.12), (1.43, 0.78, 2.12)],
            ]
        ),
    )
    pane = [(1.86, 1.32), (1.34, 2.06), (0.62, 2.06), (0.62, 1.32)]
    m.add(
        "glass",
        extrude_y(pane, -1.0, -0.95),
        extrude_y(pane, 0.95, 1.0),
        box((-2.70, 0.44, 1.75), (0.04, 0.70, 0.5)),
        box((-2.70, -0.44, 1.75), (0.04, 0.70, 0.5)),
    )
    m.add(
        "trim",
        box((0, 0, 0.38), (4.6, 1.5, 0.26)),
        box((2.70, 0, 0.48), (0.10, 1.80, 0.22)),
        box((-2.72, 0, 0.45), (0.08, 1.8, 0.16)),
        box((2.69, 0, 0.80), (0.06, 0.9, 0.14)),
        box((-0.8, 0.99, 1.15), (3.2, 0.03, 0.06)),
        box((-0.8, -0.99, 1.15), (3.2, 0.03, 0.06)),
    )
    m.collide_hull(m.parts["paint"][0], box((0, 0, 0.3), (4.2, 1.9, 0.6)))
    lamps(m, 2.62, -2.70, 0.74, 0.86, 1.05)
    mirrors(m, 1.75, 1.07, 1.50, 0.30)
    wheels(m, (1.72, -1.72), 0.86, 0.35, 0.23)
    return m


def truck() -> Model:
    m = Model(
        "truck",
        "truck",
        "vehicle",
        "Two-axle box truck.",
        7500,
        0.45,
        paint="paint",
        colours={"paint": (0.16, 0.30, 0.55)},
    )
    cab = [
        (3.80, 0.55),
        (3.85, 1.45),
        (3.62, 2.55),
        (3.40, 2.75),
        (2.15, 2.75),
        (2.15, 0.95),
        (2.30, 0.95),
        *arch(2.75, 0.56, 0.5)[::-1],
        (3.3, 0.5),
    ]
    m.add("paint", shell(cab, 2.36, 0.08))
    m.add("white", box((-1.05, 0, 2.15), (5.9, 2.50, 2.40)))
    m.add(
        "steel",
        *(box((-1.05, y, z), (5.94, 0.06, 0.10)) for y in (1.24, -1.24) for z in (0.98, 3.33)),
        *(box((-4.0, y, 2.15), (0.06, 0.08, 2.4)) for y in (1.21, 0, -1.21)),
    )
    m.add(
        "dark_steel",
        box((-0.3, 0, 0.78), (7.2, 0.9, 0.30)),
        box((-3.95, 0, 0.55), (0.10, 2.3, 0.14)),
        box((0.3, 1.0, 0.62), (1.6, 0.4, 0.5)),
        box((-0.2, -1.0, 0.62), (1.0, 0.4, 0.5)),
    )
    m.add(
        "glass",
        loft([[(3.83, y, 1.60), (3.87, y, 1.60), (3.68, y, 2.46), (3.64, y, 2.46)] for y in (-1.04, 1.04)]),
        *(
            extrude_y([(3.60, 1.62), (3.45, 2.42), (2.70, 2.42), (2.70, 1.62)], a, b)
            for a, b in ((-1.19, -1.15), (1.15, 1.19))
        ),
    )
    m.add("trim", box((3.82, 0, 0.66), (0.14, 2.36, 0.30)), box((3.86, 0, 1.15), (0.05, 1.5, 0.40)))
    lamps(m, 3.86, -3.98, 0.95, 0.95, 0.72)
    mirrors(m, 3.55, 1.30, 1.95, 0.55)
    wheels(m, (2.75, -2.35), 1.08, 0.48, 0.30)
    m.collide_hull(m.parts["paint"][0], *m.parts["tyre"][:2])
    m.collide_box((-1.05, 0, 1.69), (5.94, 2.5, 3.38))
    return m


def bus() -> Model:
    m = Model(
        "bus",
        "truck",
        "vehicle",
        "City bus; counted as a truck.",
        11500,
        0.40,
        paint="paint",
        colours={"paint": (0.75, 0.12, 0.10)},
    )
    side = [
        (5.5, 0.4),
        (5.55, 1.2),
        (5.42, 2.7),
        (5.2, 2.98),
        (-5.35, 3.0),
        (-5.5, 2.7),
        (-5.5, 0.4),
        *arch(-2.9, 0.58, 0.33)[::-1],
        *arch(2.8, 0.58, 0.33)[::-1],
        (5.3, 0.33),
    ]
    m.add("paint", shell(side, 2.5, 0.08))
    for side_y in (1, -1):
        m.add("glass", *(box((-4.5 + 1.5 * k, side_y * 1.235, 1.85), (1.36, 0.05, 0.95)) for k in range(7)))
    for x in (4.85, 0.2):
        m.add("glass", box((x, -1.24, 1.35), (1.0, 0.05, 1.85)))
    m.add(
        "glass",
        loft([[(5.50, y, 1.15), (5.58, y, 1.15), (5.46, y, 2.5), (5.38, y, 2.5)] for y in (-1.1, 1.1)]),
        box((-5.5, 0, 2.1), (0.05, 1.9, 0.8)),
    )
    m.add("white", box((0, 0, 3.08), (6.5, 1.6, 0.2)), box((5.42, 0, 2.68), (0.1, 1.6, 0.24)))
    m.add("trim", box((0, 0, 0.5), (9.6, 1.9, 0.3)), box((5.52, 0, 0.45), (0.1, 2.4, 0.24)))
    lamps(m, 5.53, -5.52, 0.95, 0.78, 0.9)
    mirrors(m, 5.5, 1.35, 2.2, 0.45)
    wheels(m, (2.8, -2.9), 1.08, 0.48, 0.28)
    return m
