"""Writes one model folder: model.xml, one OBJ for each material, README.md."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from solids import Solid, join

ASSETS = Path(__file__).parent


@dataclass
class Model:
    """Parts by material name; mass_kg and shape are for the collision geom."""

    name: str
    category: str
    kind: str  # "vehicle" | "pedestrian" | "static"
    about: str
    mass_kg: float
    reflectivity: float
    distribution: str = "id"
    collision: str = "box"  # or "cylinder"
    paint: str | None = None
    colours: dict[str, tuple] = field(default_factory=dict)
    parts: dict[str, list[Solid]] = field(default_factory=dict)

    def add(self, material: str, *solids: Solid) -> None:
        self.parts.setdefault(material, []).extend(solids)

    def write(self) -> tuple[np.ndarray, int]:
        """Centres the footprint on the origin and stands it on the ground. Returns size, bytes."""
        meshes = {m: join(s) for m, s in self.parts.items()}
        everything = np.concatenate([v for v, _ in meshes.values()])
        low, high = everything.min(0), everything.max(0)
        shift = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
        size = high - low

        folder = ASSETS / self.name
        if folder.exists():
            shutil.rmtree(folder)
        folder.mkdir()
        for material, (v, f) in meshes.items():
            (folder / f"{material}.obj").write_text(obj_text(v - shift, f))
        (folder / "model.xml").write_text(self.xml(meshes, size))
        (folder / "README.md").write_text(self.readme(size))
        return size, sum(p.stat().st_size for p in folder.iterdir())

    def xml(self, meshes: dict, size: np.ndarray) -> str:
        n = self.name
        custom = [
            f'<text name="category" data="{self.category}"/>',
            f'<text name="kind" data="{self.kind}"/>',
            f'<text name="distribution" data="{self.distribution}"/>',
            f'<numeric name="reflectivity" data="{self.reflectivity:g}"/>',
        ]
        if self.paint:
            custom.append(f'<text name="paint" data="{n}/{self.paint}"/>')
        asset, geoms = [], []
        for material in meshes:
            rgba = self.colours.get(material) or COLOURS[material]
            shine = SHINE.get(material, 0.1)
            colour = " ".join(f"{c:g}" for c in (*rgba, 1))
            asset.append(
                f'<material name="{n}/{material}" rgba="{colour}" specular="{shine:g}"'
                f' shininess="{shine:g}"/>'
            )
        for material in meshes:
            asset.append(f'<mesh name="{n}/{material}" file="{material}.obj"/>')
            geoms.append(
                f'<geom type="mesh" mesh="{n}/{material}" material="{n}/{material}"'
                ' group="2" contype="0" conaffinity="0" mass="0"/>'
            )
        x, y, z = size / 2
        if self.collision == "cylinder":
            shape = f'type="cylinder" size="{max(x, y):.3f} {z:.3f}"'
        else:
            shape = f'type="box" size="{x:.3f} {y:.3f} {z:.3f}"'
        geoms.append(f'<geom {shape} pos="0 0 {z:.3f}" group="3" mass="{self.mass_kg:g}"/>')
        pad = lambda rows, k: "\n".join(" " * k + r for r in rows)  # noqa: E731
        return (
            f'<mujoco model="{n}">\n  <custom>\n{pad(custom, 4)}\n  </custom>\n'
            f'  <asset>\n{pad(asset, 4)}\n  </asset>\n  <worldbody>\n    <body name="{n}">\n'
            f"{pad(geoms, 6)}\n    </body>\n  </worldbody>\n</mujoco>\n"
        )

    def readme(self, size: np.ndarray) -> str:
        l, w, h = size
        return (
            f"# {self.name}\n\n{self.about}\n\n"
            f"Size (x, y, z): {l:.2f} x {w:.2f} x {h:.2f} m. Mass {self.mass_kg:g} kg.\n\n"
            "Provenance: harmzone's own work, written by `../make_models.py`; no outside mesh or\n"
            "texture. Licence: `../LICENSE`.\n"
        )


def obj_text(v: np.ndarray, f: np.ndarray) -> str:
    """Millimetres are enough; vertices that fall together within one solid stay apart (creases)."""
    lines = [
        "v " + " ".join(f"{c + 0.0:.3f}".rstrip("0").rstrip(".") for c in p) for p in np.round(v, 3) + 0.0
    ]
    keep = [t for t in f if np.linalg.norm(np.cross(v[t[1]] - v[t[0]], v[t[2]] - v[t[0]])) > 1e-7]
    lines += ["f " + " ".join(str(k + 1) for k in t) for t in keep]
    return "\n".join(lines) + "\n"


# Colours that several models share; a model's own `colours` come first.
COLOURS = {
    "glass": (0.10, 0.13, 0.16),
    "tyre": (0.06, 0.06, 0.065),
    "rim": (0.62, 0.63, 0.65),
    "trim": (0.08, 0.08, 0.09),
    "headlamp": (0.95, 0.94, 0.86),
    "taillamp": (0.62, 0.04, 0.04),
    "plate": (0.88, 0.88, 0.84),
    "steel": (0.55, 0.56, 0.58),
    "dark_steel": (0.18, 0.19, 0.20),
    "wood": (0.50, 0.33, 0.18),
    "concrete": (0.62, 0.61, 0.58),
    "white": (0.92, 0.92, 0.90),
    "skin": (0.78, 0.58, 0.46),
    "hair": (0.16, 0.11, 0.08),
    "shoe": (0.09, 0.08, 0.08),
    "black": (0.05, 0.05, 0.05),
    "leaves": (0.18, 0.36, 0.13),
    "bark": (0.30, 0.22, 0.15),
    "red": (0.78, 0.08, 0.07),
    "yellow": (0.93, 0.74, 0.08),
    "blue": (0.08, 0.22, 0.58),
    "orange": (0.95, 0.36, 0.05),
    "green": (0.10, 0.38, 0.20),
    "lamp": (0.98, 0.95, 0.82),
    "tape": (0.80, 0.66, 0.42),
    "card": (0.66, 0.48, 0.30),
    "straw": (0.80, 0.66, 0.30),
    "strap": (0.75, 0.30, 0.10),
    "paper": (0.90, 0.89, 0.84),
    "soil": (0.22, 0.15, 0.10),
}
SHINE = {"glass": 0.8, "paint": 0.6, "rim": 0.5, "headlamp": 0.7, "taillamp": 0.6, "steel": 0.4}
