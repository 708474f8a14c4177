# `make weathers`; needs what `make setup-test` makes.
"""The pictures of docs/weather.md: one frame in all weathers, and its LiDAR points in three of them.

Generates an episode in each weather into FOLDER (kept, so that a second run only draws).
"""

from __future__ import annotations

import argparse
import io
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from PIL import Image, ImageDraw, ImageFont

ROOT = Path(__file__).parents[1]
PICTURES = ROOT / "docs" / "pictures"
SKIES = re.findall(r"^ +(\w+)Noon +\w+Sunset +", (ROOT / "src/sensors/weather.rs").read_text(), re.M)
DAYTIMES = ("Noon", "Sunset", "Night")
# The same drive in every weather: the streams of traffic and objects do not know the weather.
DRIVE = ("--town", "downtown", "--episodes", "1", "--samples", "3", "--seed", "21", "--jobs", "1")
TILE_PX = (400, 225)
LABEL_PX = 18
GAP_PX = 4

FROM_ABOVE = ("ClearNoon", "HardRainNoon", "FogNoon")
PIXELS_PER_M = 8
AHEAD_M, ASIDE_M = 70, 25
RING_STEP_M = 10
ABOVE_M, BELOW_M = 3, 3
CLOSE_PIXELS_PER_M = 24
BRIGHTEST = 100.0
NIGHT_BLUE, GREY, WHITE = (16, 18, 24), (62, 66, 76), (225, 228, 235)


def generate(harmzone: Path, folder: Path, weather: str) -> Path:
    """The file of the only episode in a weather; one that is there already stays."""
    out = folder / weather
    subprocess.run(
        [harmzone, "gen", *DRIVE, "--weather", weather, "--set", "warm_up_s=[4.0, 4.0]", "--out", out],
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL if (out / "dataset.json").exists() else None,
    )
    (episode,) = (out / "episodes").glob("*.mcap")
    return episode


def last_sample(episode: Path) -> tuple[Image.Image, np.ndarray]:
    """The camera's picture, and rows of x, y, z and intensity, of the episode's last sample."""
    last = {}
    with episode.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        topics = ["/cam_front/image_rect_compressed", "/lidar_top"]
        for _, channel, _, message in reader.iter_decoded_messages(topics=topics):
            last[channel.topic] = message
    cloud = last["/lidar_top"]
    offsets = {field.name: field.offset for field in cloud.fields}
    names = ["x", "y", "z", "intensity"]
    layout = np.dtype(
        {
            "names": names,
            "formats": ["<f4"] * 4,
            "offsets": [offsets[name] for name in names],
            "itemsize": cloud.point_stride,
        }
    )
    points = np.frombuffer(cloud.data, layout)
    image = Image.open(io.BytesIO(last["/cam_front/image_rect_compressed"].data))
    return image, np.stack([points[name] for name in names], axis=1)


def contact_sheet(frames: dict[str, Image.Image]) -> Image.Image:
    """A row for each sky, a column for each daytime, every frame under its weather's name."""
    width, height = TILE_PX[0] + GAP_PX, TILE_PX[1] + LABEL_PX + GAP_PX
    sheet = Image.new("RGB", (width * len(DAYTIMES) + GAP_PX, height * len(SKIES)), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(13)
    for row, sky in enumerate(SKIES):
        for column, daytime in enumerate(DAYTIMES):
            x, y = GAP_PX + column * width, row * height
            pen.text((x + 2, y + 1), sky + daytime, "black", font)
            frame = frames[sky + daytime].resize(TILE_PX, Image.Resampling.LANCZOS)
            sheet.paste(frame, (x, y + LABEL_PX))
    return sheet


def from_above(title: str, points: np.ndarray) -> Image.Image:
    """Points seen from above, the LiDAR at the bottom looking up; blue returns are weak, red ones strong."""
    size = np.array([2 * ASIDE_M, AHEAD_M + 2]) * PIXELS_PER_M
    panel = Image.new("RGB", tuple(size), NIGHT_BLUE)
    pen, font = ImageDraw.Draw(panel), ImageFont.load_default(13)
    origin = np.array([ASIDE_M, AHEAD_M + 1]) * PIXELS_PER_M
    half_view_deg = 35
    for range_m in range(RING_STEP_M, AHEAD_M + 1, RING_STEP_M):
        reach = range_m * PIXELS_PER_M
        pen.arc([*(origin - reach), *(origin + reach)], 270 - half_view_deg, 270 + half_view_deg, GREY)
        right = min(reach * np.sin(np.radians(half_view_deg)), size[0] / 2 - 36)
        ahead = np.sqrt(reach**2 - right**2)
        pen.text((origin[0] + right, origin[1] - ahead + 4), f"{range_m} m", GREY, font)
    dots(pen, origin - points[:, [1, 0]] * PIXELS_PER_M, points[:, 3])
    pen.text((8, 6), f"{title}: {len(points)} points", WHITE, font)
    return panel


def from_the_side(points: np.ndarray) -> Image.Image:
    """The nearest of the points, the LiDAR on the left looking right."""
    size = np.array([2 * ASIDE_M * PIXELS_PER_M, (ABOVE_M + BELOW_M) * CLOSE_PIXELS_PER_M])
    panel = Image.new("RGB", tuple(size), NIGHT_BLUE)
    pen, font = ImageDraw.Draw(panel), ImageFont.load_default(13)
    origin = np.array([CLOSE_PIXELS_PER_M, ABOVE_M * CLOSE_PIXELS_PER_M])
    for x_m in range(0, size[0] // CLOSE_PIXELS_PER_M, RING_STEP_M // 2):
        x = origin[0] + x_m * CLOSE_PIXELS_PER_M
        pen.line([x, 0, x, size[1]], GREY)
        pen.text((x + 3, 2), f"{x_m} m", GREY, font)
    dots(pen, origin + points[:, [0, 2]] * [CLOSE_PIXELS_PER_M, -CLOSE_PIXELS_PER_M], points[:, 3])
    return panel


def dots(pen: ImageDraw.ImageDraw, at: np.ndarray, intensity: np.ndarray) -> None:
    """A dot of two pixels for each point, the strong ones over the weak."""
    at = np.rint(at).astype(int)
    shade = 0.12 + 0.83 * np.clip(intensity / BRIGHTEST, 0, 1)
    colours = (255 * colormaps["turbo"](shade)[:, :3]).astype(int)
    for i in np.argsort(intensity, kind="stable"):
        pen.rectangle([*at[i], *(at[i] + 1)], tuple(colours[i]))


def main() -> None:
    """Generates what is missing and draws both pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("harmzone", type=Path, help="the program that `make build` makes")
    parser.add_argument("folder", type=Path, help="folder for the 18 episodes")
    args = parser.parse_args()
    frames, clouds = {}, {}
    for weather in (sky + daytime for sky in SKIES for daytime in DAYTIMES):
        episode = generate(args.harmzone.resolve(), args.folder, weather)
        frames[weather], clouds[weather] = last_sample(episode)
    sheet_path, lidar_path = PICTURES / "weathers.jpg", PICTURES / "weather_lidar.png"
    contact_sheet(frames).save(sheet_path, quality=72, optimize=True)
    columns = [(from_above(name, clouds[name]), from_the_side(clouds[name])) for name in FROM_ABOVE]
    (width, above_px), (_, side_px) = (panel.size for panel in columns[0])
    size = ((width + GAP_PX) * len(columns) - GAP_PX, above_px + GAP_PX + side_px)
    row = Image.new("RGB", size, "white")
    for i, (above, side) in enumerate(columns):
        row.paste(above, (i * (width + GAP_PX), 0))
        row.paste(side, (i * (width + GAP_PX), above_px + GAP_PX))
    row.quantize(64, dither=Image.Dither.NONE).save(lidar_path, optimize=True)
    for path in (sheet_path, lidar_path):
        sys.stdout.write(f"{path.stat().st_size / 1024:.0f} kB: {path}\n")


if __name__ == "__main__":
    main()
