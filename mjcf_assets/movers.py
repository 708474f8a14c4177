"""All that moves."""

from __future__ import annotations

from model_writer import Model
from people import pedestrians
from two_wheelers import cyclist, motorcycle, scooter
from vehicles import bus, car, truck, van


def movers() -> list[Model]:
    ego = car(
        "ego",
        "ego",
        "The ego's body: a sedan. It is never rendered nor hit by its own rays.",
        (0.80, 0.82, 0.84),
        False,
    )
    return [
        car("car_sedan", "car", "Four-door sedan.", (0.62, 0.64, 0.67), False),
        car("car_hatch", "car", "Small hatchback.", (0.58, 0.10, 0.10), True),
        van(),
        truck(),
        bus(),
        cyclist(),
        motorcycle(),
        scooter(),
        ego,
        *pedestrians(),
    ]
