# Writes the PNG files beside this script. Needs Python 3.11, numpy==2.4.6, pillow==13.0.0.
"""Tiling textures: four facades and three grounds, 256 x 256 pixels, from fixed seeds."""

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

N_PX = 256
HERE = Path(__file__).parent


def grain(rgb, spread: float, seed: int, cell_px: int = 1) -> np.ndarray:
    n = N_PX // cell_px
    noise = np.random.default_rng(seed).normal(0, spread, (n, n)).repeat(cell_px, 0).repeat(cell_px, 1)
    return np.asarray(rgb, float) + noise[..., None]


def picture(pixels: np.ndarray) -> Image.Image:
    return Image.fromarray(np.clip(pixels, 0, 255).astype(np.uint8))


def save(image: Image.Image, name: str) -> None:
    image.quantize(64).save(HERE / f"{name}.png", optimize=True)


def facade(
    name: str, wall, frame, columns: int, window, seed: int, brick: bool = False, balcony: bool = False
) -> None:
    """Two storeys to a tile; window is (width, height) as shares of its bay."""
    image = picture(grain(wall, 4, seed, 2))
    draw, rng = ImageDraw.Draw(image), np.random.default_rng(seed)
    dark = tuple(int(c * 0.82) for c in wall)
    if brick:
        for row in range(0, N_PX, 8):
            draw.line((0, row, N_PX, row), fill=dark)
            for x in range(row % 16, N_PX, 16):
                draw.line((x, row, x, row + 8), fill=dark)
    bay, storey = N_PX / columns, N_PX // 2
    for floor in range(2):
        y = floor * storey
        draw.rectangle((0, y, N_PX, y + 4), fill=dark)
        for k in range(columns):
            w, h = window[0] * bay, window[1] * storey
            x0, y0 = (k + 0.5) * bay - w / 2, y + (storey - h) * 0.5
            draw.rectangle((x0 - 4, y0 - 4, x0 + w + 4, y0 + h + 4), fill=frame)
            tone = int(rng.integers(0, 40))
            draw.rectangle((x0, y0, x0 + w, y0 + h), fill=(38 + tone, 50 + tone, 64 + tone))
            if rng.random() < 0.4:
                draw.rectangle((x0, y0, x0 + w, y0 + h * rng.uniform(0.2, 0.6)), fill=(196, 190, 176))
            draw.line((x0 + w / 2, y0, x0 + w / 2, y0 + h), fill=frame, width=3)
            if balcony:
                draw.rectangle((x0 - 8, y0 + h * 0.68, x0 + w + 8, y0 + h + 6), outline=(40, 40, 42), width=2)
                for x in range(int(x0 - 8), int(x0 + w + 8), 6):
                    draw.line((x, y0 + h * 0.68, x, y0 + h + 6), fill=(40, 40, 42))
    save(image, name)


def main() -> None:
    facade("facade_a", (176, 160, 134), (225, 218, 202), 3, (0.42, 0.62), 1, balcony=True)
    facade("facade_b", (142, 82, 64), (214, 206, 192), 3, (0.45, 0.55), 2, brick=True)
    facade("facade_c", (150, 154, 158), (92, 96, 100), 4, (0.80, 0.62), 3)
    facade("facade_d", (202, 184, 140), (120, 84, 58), 2, (0.36, 0.66), 4)
    save(picture(grain((72, 73, 75), 7, 5) + grain((0, 0, 0), 4, 6, 4)), "asphalt")
    slabs = picture(grain((158, 154, 147), 4, 7) + grain((0, 0, 0), 5, 8, 64))
    for k in range(0, N_PX, 64):
        ImageDraw.Draw(slabs).line((k, 0, k, N_PX), fill=(120, 117, 111), width=2)
        ImageDraw.Draw(slabs).line((0, k, N_PX, k), fill=(120, 117, 111), width=2)
    save(slabs, "pavement")
    save(picture(grain((84, 112, 58), 12, 9) + grain((0, 0, 0), 6, 10, 8)), "grass")


if __name__ == "__main__":
    main()
