"""More shapes of traffic, with the proportions of real classes: wheelbase, overhangs, glass angles.

What ends in `_door_open` only parks: towns name it in `parked_weights` alone, and its weight is 0 elsewhere.
"""

from __future__ import annotations

import math

from car_body import Body, fittings
from model_writer import Model
from solids import box, moved, wheel

COLOURS = {"mirror": (0.09, 0.09, 0.10), "seat": (0.23, 0.22, 0.21)}


def vehicle(name: str, category: str, about: str, mass_kg: float, paint: tuple, **more) -> Model:
    colours = {"paint": paint, **COLOURS}
    return Model(name, category, "vehicle", about, mass_kg, 0.35, paint="paint", colours=colours, **more)


def with_door(
    name: str, category: str, abouts: tuple[str, str], mass_kg: float, paint: tuple, is_open: bool
) -> Model:
    """Closed, or parked with an open door and somebody's things in it; `abouts` tell of both."""
    if is_open:
        return vehicle(f"{name}_door_open", category, abouts[1], mass_kg + 20, paint, weight=0.0)
    return vehicle(name, category, abouts[0], mass_kg, paint)


def estate() -> Model:
    m = vehicle("car_estate", "car", "Estate, 2.79 m of wheelbase.", 1480, (0.13, 0.17, 0.24))
    body = Body(
        top=[(2.37, 0.66), (2.33, 0.74), (2.1, 0.84), (1.6, 0.93), (1.02, 1.00), (0.18, 1.41), (-0.2, 1.465),
             (-0.8, 1.475), (-1.4, 1.455), (-1.98, 1.40), (-2.24, 1.02), (-2.34, 0.93), (-2.37, 0.70)],
        belt=[(2.4, 0.90), (1.0, 0.92), (-1.2, 0.97), (-2.4, 1.02)],
        width=1.82, axles=(1.43, -1.36), wheel_radius=0.325,
        windscreen=(1.02, 0.18), rear_glass=(-1.98, -2.24),
        panes=[(0.78, -0.14), (-0.22, -1.10), (-1.18, -1.92)],
    )  # fmt: skip
    body.build(m)
    for y in (0.56, -0.56):
        m.add("trim", box((-0.85, y, 1.475), (1.9, 0.035, 0.035)))
    fittings(m, body, mirror=(0.70, 1.0, 0.15), rear_plate_z=0.66)
    return m


def suv() -> Model:
    m = vehicle("car_suv", "car", "Large SUV on high wheels.", 1850, (0.07, 0.07, 0.08))
    body = Body(
        top=[(2.34, 0.82), (2.31, 0.94), (2.1, 1.03), (1.6, 1.09), (1.12, 1.14), (0.42, 1.60), (0.0, 1.675),
             (-0.8, 1.69), (-1.6, 1.655), (-1.98, 1.60), (-2.22, 1.20), (-2.31, 1.10), (-2.34, 0.85)],
        belt=[(2.4, 1.02), (1.0, 1.07), (-1.2, 1.11), (-2.4, 1.16)],
        width=1.91, axles=(1.44, -1.34), wheel_radius=0.375, sill=0.30, roof_y=0.66, cladding=True,
        windscreen=(1.12, 0.42), rear_glass=(-1.98, -2.22),
        panes=[(0.90, 0.02), (-0.07, -0.98), (-1.10, -1.80)],
    )  # fmt: skip
    body.build(m)
    for y in (0.60, -0.60):
        m.add("steel", box((-0.7, y, 1.70), (2.0, 0.035, 0.04)))
    fittings(m, body, grille=(0.66, 1.05, 0.22), intake=(0.42, 0.14), lamp_z=(0.82, 0.96),
             lamp_size=(0.26, 0.12), mirror=(0.82, 1.16, 0.19), rear_plate_z=0.78)  # fmt: skip
    return m


def crossover() -> Model:
    m = vehicle("car_suv_small", "car", "Small SUV with a falling roof.", 1320, (0.62, 0.24, 0.07))
    body = Body(
        top=[(2.09, 0.74), (2.06, 0.86), (1.88, 0.94), (1.45, 1.01), (1.02, 1.06), (0.30, 1.48), (-0.1, 1.55),
             (-0.6, 1.565), (-1.2, 1.52), (-1.62, 1.44), (-1.96, 1.10), (-2.06, 1.02), (-2.09, 0.78)],
        belt=[(2.2, 0.94), (1.0, 0.99), (-1.0, 1.05), (-2.2, 1.12)],
        width=1.79, axles=(1.25, -1.34), wheel_radius=0.345, sill=0.27, roof_y=0.61, cladding=True,
        windscreen=(1.02, 0.30), rear_glass=(-1.62, -1.96),
        panes=[(0.80, -0.10), (-0.18, -0.98), (-1.06, -1.40)],
    )  # fmt: skip
    body.build(m)
    fittings(m, body, grille=(0.60, 0.95, 0.16), intake=(0.40, 0.14), lamp_z=(0.74, 0.90),
             mirror=(0.72, 1.08, 0.17), rear_plate_z=0.70)  # fmt: skip
    return m


def coupe() -> Model:
    m = vehicle("car_coupe", "car", "Low two-door coupe, long bonnet.", 1430, (0.55, 0.05, 0.05))
    body = Body(
        top=[(2.22, 0.58), (2.18, 0.66), (1.95, 0.76), (1.4, 0.86), (0.80, 0.92), (-0.05, 1.25),
             (-0.4, 1.295),
             (-0.8, 1.285), (-1.1, 1.24), (-1.85, 0.96), (-2.1, 0.93), (-2.19, 0.88), (-2.22, 0.66)],
        belt=[(2.3, 0.82), (0.8, 0.85), (-0.8, 0.89), (-1.4, 0.93), (-2.3, 0.92)],
        width=1.84, axles=(1.36, -1.22), wheel_radius=0.335, sill=0.17, roof_y=0.56, rail_drop=0.085,
        windscreen=(0.80, -0.05), rear_glass=(-1.10, -1.85),
        panes=[(0.58, -0.62), (-0.70, -1.28)], nose_taper=0.17, tail_taper=0.13,
    )  # fmt: skip
    body.build(m)
    fittings(m, body, grille=(0.42, 0.9, 0.14), intake=(0.27, 0.08), lamp_z=(0.56, 0.74),
             lamp_size=(0.26, 0.09), mirror=(0.52, 0.93, 0.13), rear_plate_z=0.56)  # fmt: skip
    return m


def minivan(is_open: bool) -> Model:
    abouts = "Minivan for seven.", "Minivan, its driver's door open."
    m = with_door("car_minivan", "car", abouts, 1600, (0.34, 0.36, 0.38), is_open)
    body = Body(
        top=[(2.29, 0.70), (2.25, 0.82), (2.05, 0.94), (1.75, 1.03), (1.42, 1.10), (0.45, 1.58), (0.0, 1.665),
             (-0.7, 1.69), (-1.5, 1.66), (-2.02, 1.59), (-2.20, 1.12), (-2.27, 1.02), (-2.29, 0.78)],
        belt=[(2.4, 0.95), (1.3, 0.99), (-1.0, 1.03), (-2.4, 1.08)],
        width=1.83, axles=(1.37, -1.42), wheel_radius=0.325, roof_y=0.64,
        windscreen=(1.42, 0.45), rear_glass=(-2.02, -2.20),
        panes=[(1.12, 0.66), (0.58, -0.22), (-0.30, -1.16), (-1.24, -1.94)],
        door=(0.88, -0.26) if is_open else None,
    )  # fmt: skip
    body.build(m)
    fittings(m, body, grille=(0.56, 0.9, 0.10), lamp_z=(0.68, 0.92), lamp_size=(0.24, 0.14),
             mirror=(0.98, 1.08, 0.18), rear_plate_z=0.72)  # fmt: skip
    return m


def city_car(is_open: bool) -> Model:
    abouts = "Small city car, 3.6 m.", "Small city car, its driver's door open."
    m = with_door("car_city", "car", abouts, 930, (0.85, 0.78, 0.62), is_open)
    body = Body(
        top=[(1.79, 0.68), (1.76, 0.78), (1.62, 0.88), (1.35, 0.97), (1.08, 1.03), (0.42, 1.40), (0.1, 1.475),
             (-0.5, 1.495), (-1.1, 1.45), (-1.45, 1.38), (-1.68, 1.00), (-1.76, 0.92), (-1.79, 0.72)],
        belt=[(1.9, 0.90), (1.0, 0.93), (-0.8, 0.97), (-1.9, 1.02)],
        width=1.63, axles=(1.13, -1.19), wheel_radius=0.285, roof_y=0.57,
        windscreen=(1.08, 0.42), rear_glass=(-1.45, -1.68),
        panes=[(0.88, -0.28), (-0.36, -1.10)], nose_taper=0.16, tail_taper=0.12,
        door=(0.66, -0.32) if is_open else None,
    )  # fmt: skip
    body.build(m)
    fittings(m, body, grille=(0.54, 0.6, 0.08), lamp_z=(0.66, 0.84), lamp_size=(0.20, 0.17),
             mirror=(0.72, 1.0, 0.15), rear_plate_z=0.56)  # fmt: skip
    return m


def old_saloon() -> Model:
    m = vehicle("car_saloon_old", "car", "Angular saloon of the 1980s.", 1250, (0.60, 0.55, 0.42))
    body = Body(
        top=[(2.26, 0.76), (2.23, 0.83), (1.9, 0.87), (1.4, 0.91), (0.85, 0.95), (0.26, 1.33), (-0.1, 1.39),
             (-0.7, 1.405), (-1.05, 1.36), (-1.55, 0.98), (-1.9, 0.96), (-2.23, 0.93), (-2.26, 0.86)],
        belt=[(2.3, 0.87), (0.8, 0.88), (-1.2, 0.91), (-2.3, 0.92)],
        width=1.68, axles=(1.42, -1.20), wheel_radius=0.30, roof_y=0.59, arch_gap=0.045, black_pillars=False,
        windscreen=(0.85, 0.26), rear_glass=(-1.05, -1.55),
        panes=[(0.62, -0.16), (-0.24, -0.92)], nose_taper=0.05, tail_taper=0.05, lamp_length=(0.10, 0.14),
    )  # fmt: skip
    body.build(m)
    m.add("steel", box((2.27, 0, 0.46), (0.12, 1.62, 0.12)), box((-2.27, 0, 0.46), (0.12, 1.62, 0.12)))
    for side in (1, -1):
        m.add("trim", box((0.11, side * 0.842, 0.56), (2.1, 0.02, 0.05)))
    fittings(m, body, grille=(0.67, 0.80, 0.15), intake=(0.34, 0.06), lamp_z=(0.68, 0.76),
             lamp_size=(0.34, 0.14), mirror=(0.55, 0.97, 0.12), rear_plate_z=0.64)  # fmt: skip
    return m


def compact() -> Model:
    m = vehicle("car_compact", "car", "Five-door compact, 4.3 m.", 1300, (0.72, 0.73, 0.75))
    body = Body(
        top=[(2.14, 0.64), (2.10, 0.73), (1.88, 0.84), (1.45, 0.93), (0.98, 1.00), (0.16, 1.39),
             (-0.2, 1.445),
             (-0.7, 1.455), (-1.25, 1.41), (-1.66, 1.34), (-1.98, 1.02), (-2.10, 0.94), (-2.14, 0.72)],
        belt=[(2.2, 0.89), (1.0, 0.92), (-1.0, 0.98), (-2.2, 1.04)],
        width=1.79, axles=(1.27, -1.36), wheel_radius=0.32, roof_y=0.60,
        windscreen=(0.98, 0.16), rear_glass=(-1.66, -1.98),
        panes=[(0.74, -0.18), (-0.26, -1.06), (-1.16, -1.44)],
    )  # fmt: skip
    body.build(m)
    fittings(m, body, mirror=(0.66, 1.0, 0.15), lamp_z=(0.60, 0.82), rear_plate_z=0.58)
    return m


def pickup() -> Model:
    m = vehicle("pickup", "truck", "Double-cab pick-up, its bed covered; a truck, as nuScenes counts.", 2050,
                (0.24, 0.29, 0.22))  # fmt: skip
    body = Body(
        top=[(2.65, 0.94), (2.62, 1.05), (2.4, 1.12), (1.9, 1.17), (1.42, 1.20), (0.80, 1.71), (0.4, 1.785),
             (-0.3, 1.80), (-0.72, 1.76), (-0.92, 1.18), (-1.05, 1.13), (-1.8, 1.12), (-2.58, 1.11),
             (-2.65, 1.06)],
        belt=[(2.7, 1.08), (1.3, 1.10), (-2.7, 1.12)],
        width=1.90, axles=(1.70, -1.48), wheel_radius=0.39, sill=0.40, roof_y=0.65, arch_gap=0.075,
        cladding=True,
        windscreen=(1.42, 0.80), rear_glass=(-0.72, -0.92), cover=(-1.05, -2.58),
        panes=[(1.20, 0.34), (0.26, -0.62)], nose_taper=0.08, tail_taper=0.03, lamp_length=(0.28, 0.12),
    )  # fmt: skip
    body.build(m)
    m.add("steel", box((-2.68, 0, 0.55), (0.14, 1.7, 0.16)))
    fittings(m, body, grille=(0.82, 1.15, 0.26), intake=(0.52, 0.16), lamp_z=(0.95, 0.92),
             lamp_size=(0.16, 0.20), mirror=(1.10, 1.22, 0.22), rear_plate_z=0.70)  # fmt: skip
    return m


def delivery_van(is_open: bool) -> Model:
    """A high-roofed small van; open: both rear doors stand out."""
    abouts = "High-roofed small delivery van.", "Delivery van, its rear doors open."
    m = with_door("van_delivery", "van", abouts, 1500, (0.88, 0.72, 0.12), is_open)
    body = Body(
        top=[(2.20, 0.74), (2.16, 0.88), (1.98, 1.00), (1.65, 1.10), (1.32, 1.17), (0.62, 1.68), (0.3, 1.80),
             (-0.4, 1.835), (-1.5, 1.83), (-2.10, 1.80), (-2.17, 1.66), (-2.20, 1.55)],
        belt=[(2.3, 1.02), (1.2, 1.06), (-2.3, 1.08)],
        width=1.83, axles=(1.36, -1.36), wheel_radius=0.32, roof_y=0.74, sill=0.23,
        windscreen=(1.32, 0.62), panes=[(1.06, 0.10)], tail_taper=0.03, nose_taper=0.14,
        lamp_length=(0.32, 0.10),
    )  # fmt: skip
    body.build(m)
    for side in (1, -1):
        m.add("trim", box((-0.62, side * 0.915, 1.12), (1.9, 0.02, 0.04)))
        m.add("trim", box((0.2, side * 0.915, 0.42), (1.8, 0.03, 0.09)))
    half = 0.76
    if is_open:
        m.add("black", box((-2.20, 0, 1.02), (0.03, 2 * half, 1.10)))
        for side in (1, -1):
            # Outwards about the hinge at the corner.
            place = lambda s, k=side: moved(s, (-2.22, k * (half + 0.05), 0), yaw=k * math.radians(-70))  # noqa: E731
            leaf = box((-0.02, -side * half / 2, 1.02), (0.05, half - 0.03, 1.12))
            m.add("paint", place(leaf))
            m.add("glass", place(box((-0.02, -side * half / 2, 1.33), (0.065, half - 0.2, 0.34))))
            m.add("trim", place(box((0.01, -side * half / 2, 0.85), (0.02, half - 0.15, 0.5))))
            m.collide_hull(place(leaf))
        m.add(
            "card", box((-2.14, 0.25, 0.68), (0.18, 0.5, 0.36)), box((-2.12, -0.32, 0.62), (0.15, 0.42, 0.24))
        )
    else:
        m.add(
            "glass",
            box((-2.19, 0.38, 1.33), (0.03, 0.56, 0.32)),
            box((-2.19, -0.38, 1.33), (0.03, 0.56, 0.32)),
        )
        m.add("trim", box((-2.20, 0, 1.02), (0.025, 0.03, 1.1)))
    fittings(m, body, grille=(0.62, 0.85, 0.12), lamp_z=(0.74, 0.80), lamp_size=(0.22, 0.18),
             mirror=(0.98, 1.14, 0.24), rear_plate_z=0.42)  # fmt: skip
    return m


def minibus() -> Model:
    m = vehicle("van_minibus", "van", "Minibus for sixteen.", 2900, (0.90, 0.90, 0.90))
    body = Body(
        top=[(2.97, 0.86), (2.93, 1.02), (2.75, 1.16), (2.48, 1.28), (2.25, 1.36), (1.62, 2.18), (1.3, 2.45),
             (0.9, 2.55), (-0.5, 2.58), (-2.2, 2.57), (-2.85, 2.52), (-2.94, 2.30), (-2.97, 1.95)],
        belt=[(3.0, 1.22), (2.0, 1.27), (-3.0, 1.30)],
        width=1.99, axles=(2.00, -1.66), wheel_radius=0.345, roof_y=0.80, sill=0.26, rail_drop=0.50,
        windscreen=(2.25, 1.62), rear_glass=None, tail_taper=0.03, lamp_length=(0.34, 0.10),
        panes=[(1.94, 1.00), (0.90, -0.18), (-0.28, -1.40), (-1.50, -2.72)],
    )  # fmt: skip
    body.build(m)
    m.add("glass", box((-2.96, 0, 1.62), (0.03, 1.5, 0.52)))
    fittings(m, body, grille=(0.72, 1.0, 0.14), intake=(0.46, 0.18), lamp_z=(0.86, 1.05),
             lamp_size=(0.22, 0.22), mirror=(1.86, 1.42, 0.34), rear_plate_z=0.62)  # fmt: skip
    return m


def cab(front: float, back: float) -> Body:
    """Of a van that carries a box; the rear wheels stand under the box."""
    return Body(
        top=[(front, 0.86), (front - 0.04, 1.02), (front - 0.22, 1.16), (front - 0.5, 1.28),
             (front - 0.72, 1.36),
             (front - 1.32, 2.12), (front - 1.6, 2.28), (front - 1.95, 2.31), (back, 2.31)],
        belt=[(front, 1.22), (front - 1.0, 1.27), (back, 1.28)],
        width=1.99, axles=(front - 0.97,), wheel_radius=0.345, roof_y=0.80, sill=0.26,
        windscreen=(front - 0.72, front - 1.32), panes=[(front - 1.02, front - 1.9)], tail_taper=0.0,
        lamp_length=(0.34, 0.0), rail_drop=0.16,
    )  # fmt: skip


def box_van() -> Model:
    m = vehicle("van_box", "van", "Van with a box body for furniture.", 2900, (0.20, 0.36, 0.62))
    front, back = 3.32, 1.15
    body, rear = cab(front, back), front - 0.97 - 3.66
    body.build(m)
    for y in (0.86, -0.86):
        tyre, rim = wheel(rear, y, 0.345, 0.24, n=14)
        m.add("tyre", tyre)
        m.add("rim", rim)
    m.add("white", box((-1.10, 0, 1.92), (4.42, 2.12, 2.30)))
    m.add("white", box((1.35, 0, 2.72), (0.9, 1.9, 0.6)))
    m.add("steel", *(box((-1.10, y, z), (4.44, 0.05, 0.07)) for y in (1.05, -1.05) for z in (0.78, 3.05)))
    m.add("steel", *(box((-3.30, y, 1.92), (0.05, 0.07, 2.3)) for y in (1.03, 0, -1.03)))
    m.add("dark_steel", box((-0.8, 0, 0.62), (4.7, 0.9, 0.22)), box((-3.28, 0, 0.45), (0.08, 1.9, 0.12)))
    for side in (1, -1):
        m.add("dark_steel", box((-0.3, side * 0.9, 0.55), (1.9, 0.05, 0.30)))
        m.add("taillamp", box((-3.31, side * 0.85, 0.62), (0.05, 0.24, 0.12)))
    m.collide_box((-1.10, 0, 1.92), (4.42, 2.12, 2.30))
    m.collide_box((rear, 0, 0.35), (0.6, 1.9, 0.7))
    fit_front(m, body, (front - 1.1, 1.42, 0.36))
    m.add("plate", box((-3.33, 0, 0.62), (0.02, 0.52, 0.11)))
    return m


def fit_front(m: Model, body: Body, mirror: tuple[float, float, float]) -> None:
    front, y = body.front, body.half_width_at(body.front)
    m.add("trim", box((front, 0, 0.72), (0.03, 1.0, 0.14)), box((front, 0, 0.46), (0.04, 1.5 * y, 0.18)))
    m.add("plate", box((front + 0.02, 0, 0.52), (0.02, 0.52, 0.11)))
    x, z, tall = mirror
    for side in (1, -1):
        m.add("headlamp", box((front - 0.005, side * (y - 0.14), 0.86), (0.03, 0.22, 0.22)))
        m.add("mirror", box((x, side * (body.half_width_at(x) + 0.10), z), (0.10, 0.18, tall)))


def flatbed() -> Model:
    m = vehicle("truck_flatbed", "truck", "Lorry with an open dropside bed and planks on it.", 6200,
                (0.82, 0.80, 0.76))  # fmt: skip
    front = 3.60
    body = Body(
        top=[(front, 1.32), (front - 0.05, 1.50), (front - 0.30, 2.28), (front - 0.45, 2.42),
             (front - 0.9, 2.50),
             (front - 1.72, 2.50)],
        belt=[(front, 1.42), (front - 1.8, 1.42)],
        width=2.18, axles=(front - 0.95,), wheel_radius=0.42, roof_y=0.94, sill=0.50, arch_gap=0.08,
        cladding=True,
        windscreen=(front - 0.05, front - 0.30), panes=[(front - 0.24, front - 1.10)], nose_taper=0.03,
        tail_taper=0.0, lamp_length=(0.0, 0.0), rail_drop=0.18,
    )  # fmt: skip
    body.build(m)
    rear, bed = -1.85, -0.98
    for y in (0.84, -0.84):
        tyre, rim = wheel(rear, y, 0.42, 0.44, n=14)
        m.add("tyre", tyre)
        m.add("rim", rim)
    m.add("dark_steel", box((-0.2, 0, 0.78), (6.4, 0.8, 0.24)), box((-3.50, 0, 0.52), (0.10, 2.0, 0.12)))
    m.add("wood", box((bed, 0, 1.03), (5.1, 2.16, 0.12)))
    m.add("steel", *(box((bed, y, 1.30), (5.1, 0.04, 0.42)) for y in (1.08, -1.08)))
    m.add("steel", box((bed - 2.55, 0, 1.30), (0.04, 2.2, 0.42)))
    m.add(
        "dark_steel",
        *(box((bed + dx, y, 1.28), (0.07, 0.06, 0.5)) for dx in (-2.5, -0.85, 0.85) for y in (1.1, -1.1)),
    )
    m.add("dark_steel", *(box((bed + 2.52, y, 1.72), (0.07, 0.07, 1.3)) for y in (-1.0, -0.35, 0.35, 1.0)))
    m.add(
        "dark_steel",
        box((bed + 2.52, 0, 2.34), (0.07, 2.1, 0.07)),
        box((bed + 2.52, 0, 1.85), (0.05, 2.1, 0.06)),
    )
    m.add(
        "wood", box((bed + 0.3, 0.35, 1.24), (3.6, 0.8, 0.30)), box((bed + 0.1, 0.30, 1.46), (3.2, 0.6, 0.14))
    )
    m.add("blue", box((bed - 1.3, -0.55, 1.44), (1.0, 0.8, 0.70)))
    for side in (1, -1):
        m.add("dark_steel", box((0.35, side * 0.92, 0.62), (0.9, 0.34, 0.40)))
        m.add("headlamp", box((front, side * 0.78, 0.80), (0.06, 0.34, 0.16)))
        m.add("taillamp", box((-3.54, side * 0.85, 0.72), (0.06, 0.34, 0.13)))
        m.add("mirror", box((front - 0.1, side * 1.20, 1.90), (0.12, 0.16, 0.5)))
    m.add("trim", box((front, 0, 1.08), (0.04, 1.5, 0.34)), box((front - 0.02, 0, 0.62), (0.14, 2.1, 0.24)))
    m.add(
        "plate", box((front + 0.06, 0, 0.62), (0.02, 0.52, 0.11)), box((-3.56, 0, 0.56), (0.02, 0.52, 0.11))
    )
    m.collide_box((bed, 0, 1.27), (5.14, 2.2, 0.5))
    m.collide_box((rear, 0, 0.5), (0.84, 2.1, 1.0))
    return m


def more_vehicles() -> list[Model]:
    closed = (estate, suv, crossover, coupe, old_saloon, compact, pickup, minibus, box_van, flatbed)
    with_doors = (minivan, city_car, delivery_van)
    return [make() for make in closed] + [make(is_open) for make in with_doors for is_open in (False, True)]
