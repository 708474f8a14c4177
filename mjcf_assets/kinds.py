"""A static model in and out of distribution."""

from __future__ import annotations

import math

from model_writer import Model


def prop(name: str, about: str, mass_kg: float, reflectivity=0.4, category=None, **more) -> Model:
    return Model(name, category or name, "static", about, mass_kg, reflectivity, **more)


def ood(name: str, about: str, mass_kg: float, reflectivity=0.4, **more) -> Model:
    return prop(name, about, mass_kg, reflectivity, name[:-2], distribution="ood", **more)


def half_round(width: float, straight: float, n: int = 10) -> list[tuple[float, float]]:
    """A front view: upright sides and a round top."""
    r = width / 2
    return [
        (-r, 0),
        (r, 0),
        *((r * math.cos(math.pi * k / n), straight + r * math.sin(math.pi * k / n)) for k in range(n + 1)),
    ]


def unseen(name: str, about: str, mass_kg: float, reflectivity: float, **colours: tuple) -> Model:
    """A shape of a kind that only the test split shows; `colours` are of its materials."""
    return ood(name, about, mass_kg, reflectivity, split="test", colours=colours)
