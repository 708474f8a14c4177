"""Writes one model folder: model.xml, one OBJ for each material, README.md."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from solids import Solid, join

ASSETS = Path(__file__).parent


# What a hull keeps of its vertices: the farthest one along each of these directions.
_GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
_HEIGHTS = 1 - 2 * (np.arange(160) + 0.5) / 160
_HULL_DIRECTIONS = np.concatenate(
    [
        np.stack(
            [
                np.sqrt(1 - _HEIGHTS**2) * np.cos(_GOLDEN_ANGLE * np.arange(160)),
                np.sqrt(1 - _HEIGHTS**2) * np.sin(_GOLDEN_ANGLE * np.arange(160)),
                _HEIGHTS,
            ],
            1,
        ),
        np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z]),
    ]
)


@dataclass
class Model:
    """Parts by material name, and convex shapes that stand for them in collisions.

    The mass is shared among the shapes by the volume of their bounds. Without `collide_*`, one shape
    holds the whole model: `collision` tells which.
    """

    name: str
    category: str
    kind: str  # "vehicle" | "pedestrian" | "static"
    about: str
    mass_kg: float
    reflectivity: float
    distribution: str = "id"
    # "background": seen and hit, but never annotated.
    role: str | None = None
    # Of a model that is "ood": "dev", or "test" for kinds that only reported figures see.
    split: str = "dev"
    collision: str = "box"  # or "cylinder", "hull"
    # Of sliding (1), spinning and rolling (m), as MuJoCo counts them.
    friction: tuple = (0.8, 0.01, 0.01)
    # Of contacts: 1 never bounces.
    damping: float = 0.6
    # "street": x points over the kerb; "traffic": at the drivers who come.
    faces: str | None = None
    # The axis about which it is round, if it rolls: "y" or "z".
    rolls: str | None = None
    # Against the other models of its kind, in towns that give no weights.
    weight: float = 1.0
    shapes: list[tuple] = field(default_factory=list)
    paint: str | None = None
    colours: dict[str, tuple] = field(default_factory=dict)
    parts: dict[str, list[Solid]] = field(default_factory=dict)
    # Materials whose meshes are loose sheets and enclose no volume.
    loose: set[str] = field(default_factory=set)

    def add(self, material: str, *solids: Solid) -> None:
        self.parts.setdefault(material, []).extend(solids)

    def collide_box(self, centre, size, pitch: float = 0) -> None:
        centre, size = np.asarray(centre, float), np.asarray(size, float)
        self.shapes.append(("box", centre, size, pitch))

    def collide_cylinder(self, centre, radius: float, length: float, axis: str = "z") -> None:
        """A cylinder about z, or lying along y."""
        size = np.array([2 * radius, 2 * radius, length])
        self.shapes.append(("cylinder", np.asarray(centre, float), size, axis))

    def collide_hull(self, *solids: Solid) -> None:
        v = np.round(join(list(solids))[0], 3)
        # Not a matrix product, the order of whose sums is the processor's: it decides between equal ones.
        x, y, z = (np.multiply.outer(v[:, axis], _HULL_DIRECTIONS[:, axis]) for axis in range(3))
        kept = v[sorted(set(np.argmax(x + y + z, axis=0).tolist()))]
        low, high = kept.min(0), kept.max(0)
        self.shapes.append(("hull", (low + high) / 2, high - low, np.unique(kept, axis=0)))

    def everything(self) -> list[Solid]:
        return [solid for solids in self.parts.values() for solid in solids]

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
        (folder / "model.xml").write_text(self.xml(meshes, low, high, shift))
        (folder / "README.md").write_text(self.readme(size))
        return size, sum(p.stat().st_size for p in folder.iterdir())

    def xml(self, meshes: dict, low: np.ndarray, high: np.ndarray, shift: np.ndarray) -> str:
        n = self.name
        custom = [
            f'<text name="category" data="{self.category}"/>',
            f'<text name="kind" data="{self.kind}"/>',
            f'<text name="distribution" data="{self.distribution}"/>',
            f'<numeric name="reflectivity" data="{self.reflectivity:g}"/>',
        ]
        if self.role:
            custom.append(f'<text name="role" data="{self.role}"/>')
        if self.split != "dev":
            custom.append(f'<text name="split" data="{self.split}"/>')
        if self.faces:
            custom.append(f'<text name="faces" data="{self.faces}"/>')
        if self.rolls:
            custom.append(f'<text name="rolls" data="{self.rolls}"/>')
        if self.weight != 1:
            custom.append(f'<numeric name="weight" data="{self.weight:g}"/>')
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
            shell = ' inertia="shell"' if material in self.loose else ""
            asset.append(f'<mesh name="{n}/{material}" file="{material}.obj"{shell}/>')
            geoms.append(
                f'<geom type="mesh" mesh="{n}/{material}" material="{n}/{material}"'
                ' group="2" contype="0" conaffinity="0" mass="0"/>'
            )
        if not self.shapes:
            self.whole_shape(low, high)
        volume = sum(float(np.prod(size)) for _, _, size, _ in self.shapes)
        for k, (kind, centre, size, more) in enumerate(self.shapes):
            x, y, z = size / 2
            pos = " ".join(f"{c + 0.0:.3f}" for c in np.round(centre - shift, 3) + 0.0)
            if kind == "hull":
                points = np.round(more - shift, 3) + 0.0
                text = "  ".join(" ".join(f"{c:g}" for c in p) for p in points)
                asset.append(f'<mesh name="{n}/hull_{k}" vertex="{text}" inertia="convex"/>')
                shape = f'type="mesh" mesh="{n}/hull_{k}"'
            elif kind == "cylinder":
                turn = ' quat="0.70710678 0.70710678 0 0"' if more == "y" else ""
                shape = f'type="cylinder" size="{x:.3f} {z:.3f}" pos="{pos}"{turn}'
            else:
                turn = f' quat="{np.cos(more / 2):.6f} 0 {np.sin(more / 2):.6f} 0"' if more else ""
                shape = f'type="box" size="{x:.3f} {y:.3f} {z:.3f}" pos="{pos}"{turn}'
            mass_kg = self.mass_kg * float(np.prod(size)) / volume
            friction = " ".join(f"{c:g}" for c in self.friction)
            geoms.append(
                f'<geom {shape} group="3" mass="{mass_kg:.4g}" condim="6" priority="1"'
                f' friction="{friction}" solref="0.02 {self.damping:g}"/>'
            )
        pad = lambda rows, k: "\n".join(" " * k + r for r in rows)  # noqa: E731
        return (
            f'<mujoco model="{n}">\n  <custom>\n{pad(custom, 4)}\n  </custom>\n'
            f'  <asset>\n{pad(asset, 4)}\n  </asset>\n  <worldbody>\n    <body name="{n}">\n'
            f"{pad(geoms, 6)}\n    </body>\n  </worldbody>\n</mujoco>\n"
        )

    def whole_shape(self, low: np.ndarray, high: np.ndarray) -> None:
        centre, size = (low + high) / 2, high - low
        if self.collision == "hull":
            self.collide_hull(*self.everything())
        elif self.collision == "cylinder":
            self.collide_cylinder(centre, max(size[0], size[1]) / 2, size[2])
        else:
            self.collide_box(centre, size)

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
