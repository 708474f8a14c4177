# Draws docs/gallery*.png with what `make setup-test` makes: .venv-test/bin/python mjcf_assets/make_gallery.py
"""Labelled pictures of every model folder beside this script, drawn by MuJoCo as in the episodes."""

from __future__ import annotations

import os
import sys
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

ASSETS = Path(__file__).parent
DOCS = ASSETS.parent / "docs"
TILE_PX = (176, 150)
LABEL_PX = 28
N_COLUMNS = 9
# Drawn larger than shown, against jagged edges.
OVERSAMPLING = 3
N_COLOURS = 256
# Groups of each picture: kind, distribution, split, title.
PICTURES = {
    "gallery.png": (
        ("vehicle", "id", "dev", "Vehicles"),
        ("static", "id", "dev", "Street furniture"),
        ("static", "ood", "dev", "Out of distribution: never in training data"),
    ),
    "gallery_test.png": (("static", "ood", "test", "Out of distribution, in the test split alone"),),
}


def load(folder: Path) -> tuple[mujoco.MjModel, dict[str, str]]:
    """The model on a plane under a sun, with a camera body, and its custom texts."""
    spec = mujoco.MjSpec.from_file(str(folder / "model.xml"))
    texts = {text.name: text.data for text in spec.texts}
    spec.visual.headlight.ambient = [0.55, 0.55, 0.57]
    spec.visual.headlight.diffuse = [0.25, 0.25, 0.25]
    spec.visual.headlight.specular = [0, 0, 0]
    spec.visual.global_.offwidth = TILE_PX[0] * OVERSAMPLING
    spec.visual.global_.offheight = TILE_PX[1] * OVERSAMPLING
    spec.visual.quality.shadowsize = 2048
    spec.add_texture(
        name="gallery_sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=[0.93, 0.94, 0.95],
        width=16,
        height=96,
    )
    spec.worldbody.add_geom(
        name="gallery_floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0, 0, 1],
        rgba=[0.80, 0.81, 0.82, 1],
        group=1,
    )
    light = spec.worldbody.add_light(
        pos=[6, 8, 14], dir=[-0.4, -0.5, -0.9], castshadow=True, diffuse=[0.7, 0.7, 0.66]
    )
    light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    return spec.compile(), texts


def draw(model: mujoco.MjModel) -> Image.Image:
    """From ahead, to the left and a little above, filling the tile."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    corners = []
    for geom in np.flatnonzero(model.geom_group == 2):
        centre, half = np.split(model.geom_aabb[geom], 2)
        signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
        corners.append((centre + signs * half) @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    points = np.concatenate(corners)
    low, high = points.min(0), points.max(0)
    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation = 215, -14
    camera.lookat = (low + high) / 2
    model.vis.global_.fovy = 24
    azimuth, elevation = np.radians([camera.azimuth, camera.elevation])
    forward = np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    right = np.array([np.sin(azimuth), -np.cos(azimuth), 0])
    up = np.cross(right, forward)
    offset = points - camera.lookat
    tangent = np.tan(np.radians(model.vis.global_.fovy / 2))
    reach = np.maximum(
        np.abs(offset @ up) / tangent, np.abs(offset @ right) / tangent * TILE_PX[1] / TILE_PX[0]
    )
    camera.distance = 1.06 * float((reach - offset @ forward).max())
    model.vis.map.znear, model.vis.map.zfar = 0.02, 60
    model.stat.extent = float(np.linalg.norm(high - low))
    width, height = (side * OVERSAMPLING for side in TILE_PX)
    with mujoco.Renderer(model, height, width) as renderer:
        options = mujoco.MjvOption()
        options.geomgroup[:] = [1, 1, 1, 0, 0, 0]
        renderer.update_scene(data, camera, options)
        return Image.fromarray(renderer.render()).resize(TILE_PX, Image.Resampling.LANCZOS)


def main() -> None:
    models = []
    for folder in sorted(p.parent for p in ASSETS.glob("*/model.xml")):
        if folder.name == "ego":  # never drawn: the camera is inside
            continue
        model, texts = load(folder)
        group = texts["kind"], texts["distribution"], texts.get("split", "dev")
        models.append((group, folder.name, draw(model)))
    for name, groups in PICTURES.items():
        write_sheet(DOCS / name, groups, models)


def write_sheet(path: Path, groups: tuple, models: list) -> None:
    font, heading = ImageFont.load_default(12), ImageFont.load_default(17)
    rows: list[tuple[str | None, list]] = []
    for *group, title in groups:
        found = [m for m in models if m[0] == tuple(group)]
        rows.append((f"{title} ({len(found)})", []))
        rows += [(None, found[k : k + N_COLUMNS]) for k in range(0, len(found), N_COLUMNS)]
    height_px = sum(34 if title else TILE_PX[1] + LABEL_PX for title, _ in rows) + 8
    sheet = Image.new("RGB", (N_COLUMNS * TILE_PX[0] + 8, height_px), (255, 255, 255))
    pen = ImageDraw.Draw(sheet)
    y = 4
    for title, tiles in rows:
        if title:
            pen.text((8, y + 9), title, (20, 20, 20), heading)
            y += 34
            continue
        for column, (_, name, picture) in enumerate(tiles):
            x = 4 + column * TILE_PX[0]
            sheet.paste(picture.crop((0, 0, TILE_PX[0] - 4, TILE_PX[1])), (x + 2, y))
            pen.text((x + 5, y + TILE_PX[1] + 5), name, (40, 40, 40), font)
        y += TILE_PX[1] + LABEL_PX
    sheet.quantize(N_COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
    sys.stdout.write(f"{path.stat().st_size / 1024:.0f} kB: {path}\n")


if __name__ == "__main__":
    main()
