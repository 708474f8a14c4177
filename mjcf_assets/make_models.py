# Writes every model folder beside this script. Needs Python 3.11 and numpy==2.4.6.
"""Traffic, pedestrians, street furniture and the out-of-distribution objects, as MJCF with meshes.

No randomness: the same files every time. `python make_models.py` prints each model's size.
"""

from __future__ import annotations

import sys

from movers import movers
from props import ood_props
from street import street_props


def main() -> None:
    total = 0
    for model in [*movers(), *street_props(), *ood_props()]:
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
