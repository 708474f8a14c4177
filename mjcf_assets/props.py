"""The eleven out-of-distribution kinds."""

from __future__ import annotations

from model_writer import Model
from ood_large import advertisements, barrels, cloth_containers, cones, containers, hay_bales, mailboxes
from ood_small import small_things


def ood_props() -> list[Model]:
    return [
        *barrels(),
        *mailboxes(),
        *cones(),
        *containers(),
        *cloth_containers(),
        *advertisements(),
        *hay_bales(),
        *small_things(),
    ]
