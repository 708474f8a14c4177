"""Draws a sample of an episode from its file alone: points and boxes on the picture, and both from above.

Usage: draw_episode.py EPISODES_DIR OUT.png [--episode N] [--sample N] [--camera cam_front]

For looking at: boxes should lie on the points and on the pixels of things, the ground's points at z = 0.
"""

from __future__ import annotations

import argparse
import io
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from imported_episode import Moment, read_data_set
from PIL import Image

EDGES = [(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)]
COLOURS = {"KIND_VEHICLE": "orange", "KIND_PEDESTRIAN": "cyan", "KIND_STATIC": "lime"}


def colour_of(box: object) -> str:
    """By kind; magenta out of distribution."""
    return "magenta" if box.distribution.endswith("OOD") else COLOURS.get(box.kind, "white")


def draw_picture(axes: plt.Axes, moment: Moment, name: str) -> None:
    """Points by range and boxes' edges on a camera's picture."""
    camera = moment.cameras[name]
    axes.imshow(np.array(Image.open(io.BytesIO(camera.image)).convert("RGB")))
    pixels, depth = camera.project(moment.points_in_ego())
    seen = (depth > 1) & (pixels >= 0).all(1) & (pixels < [camera.width_px, camera.height_px]).all(1)
    axes.scatter(*pixels[seen].T, c=np.log(depth[seen]), s=1.0, cmap="turbo", linewidths=0)
    for box in moment.boxes or []:
        corners, depths = camera.project(box.corners_m())
        if (depths < 0.3).any():
            continue
        for one, other in EDGES:
            axes.plot(*corners[[one, other]].T, color=colour_of(box), linewidth=1.2)
    for region in moment.ignored:
        if region.HasField("image"):
            r = region.image
            xs = [r.left_px, r.right_px, r.right_px, r.left_px, r.left_px]
            ys = [r.top_px, r.top_px, r.bottom_px, r.bottom_px, r.top_px]
            axes.plot(xs, ys, color="white", linewidth=0.8, linestyle=":")
    axes.set_xlim(0, camera.width_px)
    axes.set_ylim(camera.height_px, 0)
    axes.set_title(f"{name}, {camera.width_px} x {camera.height_px}")


def draw_above(axes: plt.Axes, moment: Moment, reach_m: float) -> None:
    """From above, the ego's x up."""
    points = moment.points_in_ego()
    axes.scatter(
        -points[:, 1], points[:, 0], s=0.4, c=np.clip(points[:, 2], -1, 3), cmap="viridis", linewidths=0
    )
    for box in moment.boxes or []:
        corners = box.corners_m()[[0, 2, 6, 4, 0]]
        axes.plot(-corners[:, 1], corners[:, 0], color=colour_of(box), linewidth=1.2)
        nose = box.center_m[:2] + np.array([np.cos(box.yaw_rad), np.sin(box.yaw_rad)]) * box.size_m[0] / 2
        axes.plot(
            [-box.center_m[1], -nose[1]], [box.center_m[0], nose[0]], color=colour_of(box), linewidth=1.2
        )
    axes.plot(0, 0, "r^")
    axes.set_facecolor("black")
    axes.set_xlim(-reach_m / 2, reach_m / 2)
    axes.set_ylim(-reach_m / 4, reach_m * 3 / 4)
    axes.set_aspect("equal")


def draw_side(axes: plt.Axes, moment: Moment) -> None:
    """From the right, points within 4 m of the ego's x axis: the ground should be a line at 0."""
    points = moment.points_in_ego()
    near = np.abs(points[:, 1]) < 4
    axes.scatter(points[near, 0], points[near, 2], s=0.4, linewidths=0)
    axes.axhline(0, color="red", linewidth=0.6)
    axes.set_xlim(-10, 50)
    axes.set_ylim(-1, 3)


def main() -> None:
    """Draws one sample."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("episodes", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--episode", type=int, default=0)
    parser.add_argument("--sample", type=int, default=0)
    parser.add_argument("--camera", default="cam_front")
    parser.add_argument("--reach", type=float, default=80.0)
    options = parser.parse_args()
    episode = list(read_data_set(options.episodes))[options.episode]
    moment = episode.moments[options.sample]
    figure = plt.figure(figsize=(15, 8), constrained_layout=True)
    grid = figure.add_gridspec(3, 2, width_ratios=[2, 1])
    draw_picture(figure.add_subplot(grid[:2, 0]), moment, options.camera)
    draw_side(figure.add_subplot(grid[2, 0]), moment)
    draw_above(figure.add_subplot(grid[:, 1]), moment, options.reach)
    state = moment.state
    figure.suptitle(
        f"{episode.path.stem} {options.sample}: {state['speed_mps']:.2f} m/s, "
        f"{state['steering_angle_rad']:.3f} rad"
    )
    figure.savefig(options.out, dpi=80)


if __name__ == "__main__":
    main()
