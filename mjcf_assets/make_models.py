# Writes the folders of the models below, beside this script. Needs Python 3.11 and numpy==2.4.6.
"""Traffic, street furniture and the out-of-distribution objects, as MJCF with meshes.

No randomness: the same files every time, a minute of work. `python make_models.py` prints each model's size.
"""

from __future__ import annotations

import sys

from model_writer import Model
from more_vehicles import more_vehicles
from ood_animals import boars, dogs
from ood_car_parts import bumpers, tyres
from ood_cargo import ladders, pallets
from ood_debris import branches, planks, rubble
from ood_deer import deer
from ood_flat import cardboard_sheets, manhole_covers
from ood_furniture import mattresses, sofas
from ood_household import carpet_rolls, washing_machines
from ood_large import advertisements, barrels, cloth_containers, cones, containers, hay_bales, mailboxes
from ood_luggage import gas_bottles, suitcases
from ood_overturned import fallen_signs, wheelie_bins
from ood_small import small_things
from ood_two_wheelers import bicycles, e_scooters
from street import street_props
from street_clutter import street_clutter
from two_wheelers import cyclist, motorcycle, scooter
from vegetation import bushes, trees
from vehicles import bus, car, truck, van


def vehicles() -> list[Model]:
    about_ego = "The ego's body: a sedan. It is never rendered nor hit by its own rays."
    return [
        car("car_sedan", "car", "Four-door sedan.", (0.62, 0.64, 0.67), False),
        car("car_hatch", "car", "Small hatchback.", (0.58, 0.10, 0.10), True),
        *(make() for make in (van, truck, bus, cyclist, motorcycle, scooter)),
        *more_vehicles(),
        car("ego", "ego", about_ego, (0.80, 0.82, 0.84), False),
    ]


def ood_props() -> list[Model]:
    kinds = (
        barrels, mailboxes, cones, containers, cloth_containers, advertisements, hay_bales, small_things,
    )  # fmt: skip
    return [model for make in kinds for model in make()]


def test_props() -> list[Model]:
    """The kinds of the test split."""
    kinds = (
        dogs, deer, boars,
        mattresses, sofas, pallets, ladders, suitcases, gas_bottles, washing_machines, carpet_rolls,
        tyres, bumpers,
        branches, planks, rubble,
        e_scooters, bicycles, wheelie_bins, fallen_signs, cardboard_sheets, manhole_covers,
    )  # fmt: skip
    return [model for make in kinds for model in make()]


def main() -> None:
    total = 0
    street = [*street_props(), *street_clutter(), *trees(), *bushes()]
    for model in [*vehicles(), *street, *ood_props(), *test_props()]:
        size, n_bytes = model.write()
        total += n_bytes
        n_triangles = sum(len(f) for solids in model.parts.values() for _, f in solids)
        sys.stdout.write(
            f"{model.name:24} {model.category:18} {size[0]:6.2f} {size[1]:6.2f} {size[2]:6.2f} m"
            f" {n_triangles:6d} triangles {n_bytes / 1024:6.1f} KiB\n"
        )
    sys.stdout.write(f"total {total / 1024:.0f} KiB\n")


if __name__ == "__main__":
    main()
