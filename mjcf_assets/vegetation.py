"""Trees of several species, which are objects, and bushes, which are background."""

from __future__ import annotations

import math
import random

import numpy as np
from kinds import prop
from leaves import any_direction, forks, in_balls, limb, outward, over_core, sheets, triangle
from model_writer import Model
from solids import box, cylinder

GREENS = {
    "leaves": (0.20, 0.37, 0.13),
    "leaves_dark": (0.12, 0.26, 0.09),
    "leaves_light": (0.32, 0.47, 0.18),
}


def tree(name: str, about: str, mass_kg: float = 500, **more) -> Model:
    made = prop(name, about, mass_kg, 0.3, category="tree", **more)
    made.colours |= GREENS
    return made


def bush(name: str, about: str, **more) -> Model:
    made = prop(name, about, 30, 0.3, category="bush", role="background", weight=0, **more)
    made.colours |= GREENS
    return made


def add_leaves(
    model: Model, leaves: list[np.ndarray], both_sides: bool = True, tones=("leaves", "leaves_dark")
):
    """Shares the leaves out among tones."""
    for k, tone in enumerate(tones):
        if leaves[k :: len(tones)]:
            model.add(tone, sheets(leaves[k :: len(tones)], both_sides))
            model.loose.add(tone)


def broadleaf() -> Model:
    rng = random.Random("tree")
    made = tree("tree", "Broadleaf street tree in leaf.", paint="leaves")
    made.add(
        "bark",
        cylinder(0.16, 0, 2.6, 8, top=0.12),
        *(
            limb((0, 0, 2.3), end, 0.09, 0.03)
            for end in ((0.8, 0.3, 3.7), (-0.8, -0.4, 3.8), (0.1, -0.8, 4.0), (-0.1, 0.7, 4.2), (0.1, 0, 5.0))
        ),
    )
    balls = [
        ((0, 0, 4.4), (1.3, 1.3, 1.15)),
        ((0.75, 0.3, 3.7), (0.85, 0.85, 0.7)),
        ((-0.75, -0.4, 3.8), (0.85, 0.85, 0.7)),
        ((0.1, -0.8, 4.0), (0.8, 0.8, 0.7)),
        ((-0.2, 0.75, 4.1), (0.8, 0.8, 0.7)),
        ((0.1, 0, 5.2), (0.85, 0.85, 0.75)),
    ]
    add_leaves(made, in_balls(balls, 280, 0.39, rng))
    return made


def birch() -> Model:
    rng = random.Random("birch")
    made = tree("tree_birch", "Birch: white stem, thin hanging leaves.", 260)
    made.colours["bark"] = (0.80, 0.79, 0.76)
    tips = [
        (0.5, 0.2, 4.4),
        (-0.5, 0.3, 4.9),
        (0.2, -0.6, 5.2),
        (-0.3, -0.3, 5.9),
        (0.3, 0.4, 6.4),
        (0, 0, 7.2),
    ]
    made.add("bark", cylinder(0.10, 0, 5.6, 7, top=0.05), limb((0, 0, 5.5), (0, 0, 7.1), 0.05, 0.02))
    made.add("twigs", *(limb((0, 0, z - 1.5), (x, y, z), 0.035, 0.012, n=4) for x, y, z in tips[:-1]))
    made.colours["twigs"] = (0.25, 0.20, 0.17)
    leaves = []
    for x, y, z in tips:
        for _ in range(8):
            at = np.array([x, y, z]) + any_direction(rng) * rng.uniform(0.15, 0.6)
            for k in range(5):
                drop = at - np.array([0, 0, 0.26 * k]) + 0.07 * any_direction(rng)
                out = any_direction(rng) * np.array([1, 1, 0.3])
                leaves.append(triangle(tuple(drop), out, 0.245, rng))
    add_leaves(made, leaves, tones=("leaves_light", "leaves"))
    return made


def poplar() -> Model:
    rng = random.Random("poplar")
    made = tree("tree_poplar", "Lombardy poplar: a tall column of leaves.", 700)
    made.add("bark", cylinder(0.19, 0, 6.5, 8, top=0.06))
    balls = [
        ((0, 0, 1.9 + 0.95 * k), (r, r, 1.0))
        for k, r in enumerate((0.62, 0.85, 0.95, 0.95, 0.9, 0.78, 0.6, 0.4))
    ]
    add_leaves(made, in_balls(balls, 310, 0.42, rng))
    return made


def conifer() -> Model:
    rng = random.Random("conifer")
    made = tree("tree_conifer", "Spruce: layers of hanging twigs down to the ground.", 450)
    made.add("bark", cylinder(0.14, 0, 6.4, 7, top=0.03))
    leaves = []
    layers = 13
    for layer in range(layers):
        height = 0.55 + 5.9 * layer / (layers - 1)
        reach = 1.55 * (1 - (height / 6.9)) + 0.12
        n = max(4, round(6 * reach))
        for k in range(n):
            angle = 2 * math.pi * (k + rng.uniform(-0.3, 0.3)) / n + 0.7 * layer
            way = np.array([math.cos(angle), math.sin(angle), -0.22])
            side = np.array([-math.sin(angle), math.cos(angle), 0.0])
            length = reach * rng.uniform(0.75, 1.1)
            for share in (0.35, 0.65, 0.95):
                at = np.array([0, 0, height]) + way * length * share
                width = 0.24 + 0.08 * rng.random()
                tip = at + way * 0.30 + np.array([0, 0, -0.08])
                leaves.append(np.array([at - side * width, at + side * width, tip]))
                hang = at + np.array([0, 0, -0.24 - 0.1 * rng.random()])
                leaves.append(np.array([at - way * 0.14, at + way * 0.16, hang + 0.08 * any_direction(rng)]))
    made.colours |= {"leaves": (0.13, 0.27, 0.16), "leaves_dark": (0.08, 0.19, 0.11)}
    add_leaves(made, leaves)
    return made


def young() -> Model:
    rng = random.Random("young")
    made = tree("tree_young", "Young street tree between two stakes.", 60)
    made.add("bark", cylinder(0.045, 0, 2.6, 7, top=0.03), limb((0, 0, 2.5), (0.05, 0, 3.4), 0.025, 0.01))
    made.add(
        "wood",
        *(cylinder(0.04, 0, 1.7, 6, (0, y)) for y in (-0.35, 0.35)),
        box((0, 0, 1.6), (0.04, 0.76, 0.07)),
    )
    balls = [((0, 0, 2.75), (0.6, 0.6, 0.6)), ((0.1, 0.1, 3.3), (0.45, 0.45, 0.45))]
    add_leaves(made, in_balls(balls, 120, 0.225, rng, shell=0.2), tones=("leaves_light", "leaves"))
    made.collide_box((0, 0, 0.85), (0.3, 0.8, 1.7))
    return made


def bare() -> Model:
    rng = random.Random("bare")
    made = tree("tree_bare", "Tree without leaves: limbs and twigs alone.", 480)
    made.add("bark", cylinder(0.17, 0, 2.3, 8, top=0.13))
    twigs: list[np.ndarray] = []
    for k in range(4):
        angle = 2 * math.pi * k / 4 + 0.4
        way = np.array([0.42 * math.cos(angle), 0.42 * math.sin(angle), 0.95])
        limbs, thin, _ = forks(np.array([0, 0, 2.1]), way, 0.085, 3, rng, 0.42)
        made.add("bark", *limbs)
        twigs += thin
    made.add("twigs", sheets(twigs))
    made.loose.add("twigs")
    made.colours["twigs"] = (0.27, 0.21, 0.17)
    return made


def autumn() -> Model:
    rng = random.Random("autumn")
    made = tree("tree_autumn", "Maple in autumn, half of its leaves gone.", 520)
    made.add("bark", cylinder(0.15, 0, 2.2, 8, top=0.12))
    leaves: list[np.ndarray] = []
    for k in range(5):
        angle = 2 * math.pi * k / 5
        way = np.array([0.5 * math.cos(angle), 0.5 * math.sin(angle), 1.0])
        limbs, _, tips = forks(np.array([0, 0, 2.0]), way, 0.07, 2, rng, 0.45)
        made.add("bark", *limbs)
        for tip in tips:
            for _ in range(4):
                at = tip + any_direction(rng) * rng.uniform(0.05, 0.45)
                leaves.append(triangle(tuple(at), any_direction(rng), 0.29, rng))
    made.colours |= {"leaves": (0.72, 0.40, 0.10), "leaves_dark": (0.55, 0.22, 0.08)}
    add_leaves(made, leaves)
    return made


def trees() -> list[Model]:
    made = [broadleaf(), birch(), poplar(), conifer(), young(), bare(), autumn()]
    for model in made:
        trunk = min(max(abs(v[:, :2]).max() for v, _ in model.parts["bark"][:1]), 0.2)
        model.collide_cylinder((0, 0, 1.25), trunk, 2.5)
        crowns = [solid for tone in sorted(model.loose) for solid in model.parts[tone]]
        model.collide_hull(*crowns)
    return made


def hedge() -> Model:
    """Leaves over a core that hides what is behind, so that one side each is enough."""
    rng = random.Random("hedge")
    made = prop("hedge", "Clipped garden hedge.", 60, 0.3, weight=0, role="background", paint="leaves")
    made.colours |= GREENS
    made.add("leaves_dark", box((0, 0, 0.57), (0.50, 2.30, 1.06)))
    leaves = []
    for side in (-1, 1):
        for _ in range(40):
            at = (side * rng.uniform(0.22, 0.33), rng.uniform(-1.18, 1.18), rng.uniform(0.06, 1.15))
            leaves.append(triangle(at, np.array([side, 0, 0.25]) + 0.9 * any_direction(rng), 0.27, rng))
        for _ in range(10):
            at = (rng.uniform(-0.28, 0.28), side * rng.uniform(1.12, 1.22), rng.uniform(0.06, 1.15))
            leaves.append(triangle(at, np.array([0, side, 0.25]) + 0.9 * any_direction(rng), 0.27, rng))
        for _ in range(14):
            at = (rng.uniform(-0.3, 0.3), rng.uniform(-1.18, 1.18), rng.uniform(1.06, 1.2))
            leaves.append(triangle(at, np.array([0, 0, 1]) + 0.9 * any_direction(rng), 0.27, rng))
    leaves = [np.maximum(leaf, (-np.inf, -np.inf, 0.0)) for leaf in leaves]
    add_leaves(
        made, outward(leaves, np.array([0, 0, 0.5])), both_sides=False, tones=("leaves", "leaves_light")
    )
    made.collide_box((0, 0, 0.6), (0.66, 2.4, 1.2))
    return made


def bushes() -> list[Model]:
    """Wild and clipped bushes; all but the bare one hide what is behind them."""
    shapes = {
        "bush_round": ("Clipped round bush.", [((0, 0, 0.45), (0.55, 0.55, 0.52))], 50, 0.24),
        "bush_low": (
            "Creeping juniper.",
            [((0, 0, 0.16), (0.9, 0.6, 0.28)), ((0.5, 0.4, 0.14), (0.5, 0.5, 0.24))],
            50,
            0.28,
        ),
        "bush_wild": (
            "Wild bush of several stems.",
            [
                ((0, 0, 0.8), (0.7, 0.7, 0.75)),
                ((0.55, 0.3, 0.55), (0.5, 0.5, 0.5)),
                ((-0.4, -0.45, 0.6), (0.5, 0.5, 0.55)),
            ],
            85,
            0.32,
        ),
        "bush_tall": (
            "Thicket higher than a man.",
            [
                ((0, 0, 1.3), (0.9, 0.9, 1.3)),
                ((0.7, 0.4, 1.0), (0.7, 0.7, 0.95)),
                ((-0.6, -0.5, 1.6), (0.7, 0.7, 1.0)),
            ],
            115,
            0.39,
        ),
        "bush_column": ("Thuja, a column.", [((0, 0, 1.0), (0.42, 0.42, 1.05))], 60, 0.28),
    }
    made = []
    for name, (about, balls, n, size_m) in shapes.items():
        rng = random.Random(name)
        model = bush(name, about, collision="cylinder")
        outward, skin = over_core(balls, n, size_m, rng)
        wider = [(centre, tuple(1.05 * r for r in radii)) for centre, radii in balls]
        around = in_balls(wider, n // 4, 0.8 * size_m, rng, 0.9)
        loose = [leaf for leaf in around if leaf[:, 2].min() > 0.02]
        add_leaves(model, outward, both_sides=False)
        add_leaves(model, loose, tones=("leaves_light",))
        model.add("leaves_dark", sheets(skin, both_sides=False))
        made.append(model)
    made.append(hedge())
    rng = random.Random("bush_bare")
    model = bush("bush_bare", "Bush in winter: stems and twigs.", collision="cylinder")
    twigs: list[np.ndarray] = []
    for k in range(4):
        angle = 2 * math.pi * k / 4
        foot = np.array([0.12 * math.cos(angle), 0.12 * math.sin(angle), 0.0])
        way = np.array([0.25 * math.cos(angle), 0.25 * math.sin(angle), 0.5])
        limbs, thin, _ = forks(foot, way, 0.02, 2, rng)
        model.add("bark", *limbs)
        twigs += thin
    model.add("twigs", sheets(twigs))
    model.loose.add("twigs")
    model.colours["twigs"] = (0.33, 0.27, 0.20)
    made.append(model)
    return made
