"""Writes a recording for Rerun of what `harmzone view --rrd` tells on standard input.

Usage: python _rerun.py OUT. Needs rerun-sdk alone. The input is a header and then samples: a line of JSON
each, which says how many bytes follow it. Lengths are metres, positions in the ego frame, transforms rows of
4 x 4.
"""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

if TYPE_CHECKING:
    from collections.abc import Iterator

EGO = "world/ego"
CAMERA = f"{EGO}/camera"
TIMELINE = "time"
# Sizes in points of the screen.
POINT_SIZE = 1.6
TRUTH_LINE = 1.2
PREDICTED_LINE = 2.4
ZONE_LINE = 2.0
ZONE_ALPHA = 50
# The zone lies a little above the road, so that the two do not flicker through each other, metres.
ZONE_Z_M = 0.05
# Of plots: entity, the key of a sample and the name of the line.
PLOTS = {
    "speed": [("speed_mps", "speed, m/s", "text")],
    "steering": [("steering_deg", "steering, degrees to the left", "text")],
    "zone": [("zone_depth_m", "zone beyond the bumper, m", "zone")],
    "harmful": [
        ("n_harmful", "harmful", "harmful"),
        ("n_predicted_harmful", "predicted harmful", "predicted_harmful"),
    ],
}


def messages(stream: BinaryIO) -> Iterator[tuple[dict[str, Any], list[bytes]]]:
    """The messages of the input: what they say, and the bytes after them."""
    while line := stream.readline():
        said = json.loads(line)
        yield said, [stream.read(n) for n in said["bytes"]]


def place(entity: str, to_from: list[list[float]], *, static: bool = False) -> None:
    """Where an entity's frame lies in that of its parent."""
    matrix = np.asarray(to_from)
    rr.log(entity, rr.Transform3D(translation=matrix[:3, 3], mat3x3=matrix[:3, :3]), static=static)


def boxes(entity: str, found: list[dict[str, Any]], color: list[int], line: float) -> None:
    """Boxes of one colour; none takes those before away."""
    half = [np.asarray(one["size_m"]) / 2 for one in found]
    turns = [rr.RotationAxisAngle(axis=[0, 0, 1], radians=one["yaw_rad"]) for one in found]
    rr.log(
        entity,
        rr.Boxes3D(
            centers=[one["center_m"] for one in found],
            half_sizes=half,
            rotation_axis_angles=turns,
            colors=[color] * len(found),
            labels=[one["label"] for one in found],
            show_labels=any(one["label"] for one in found),
            radii=rr.Radius.ui_points(line),
        ),
    )


def log_header(said: dict[str, Any], car_glb: bytes) -> None:
    """What stays: axes, the map, the ego's car, the names and colours of lines."""
    colors = said["colors"]
    rr.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    if said["lane_lines"]:
        rr.log(
            "world/map/lanes",
            rr.LineStrips3D(said["lane_lines"], colors=[colors["ring"]], radii=0.06),
            static=True,
        )
    if said["road"]:
        corners = np.asarray(said["road"]).reshape(-1, 3)
        shades = np.tile(colors["road"], (len(corners), 1))
        rr.log("world/map/road", rr.Mesh3D(vertex_positions=corners, vertex_colors=shades), static=True)
    # The model's y is up.
    upright = rr.RotationAxisAngle(axis=[1, 0, 0], degrees=90)
    rr.log(f"{EGO}/car", rr.Transform3D(translation=[said["car_x_m"], 0, 0], rotation=upright), static=True)
    rr.log(f"{EGO}/car", rr.Asset3D(contents=car_glb, media_type="model/gltf-binary"), static=True)
    for plot, lines in PLOTS.items():
        for key, name, color in lines:
            rr.log(
                f"plots/{plot}/{key}",
                rr.SeriesLines(colors=[colors[color]], names=[name], widths=[2]),
                static=True,
            )


def log_zone(corners: list[list[float]], color: list[int]) -> None:
    """The zone's outline and its inside: corners run out along one side and back along the other."""
    ground = [[x, y, ZONE_Z_M] for x, y in corners]
    rr.log(
        f"{EGO}/zone/outline",
        rr.LineStrips3D([[*ground, ground[0]]], colors=[color], radii=rr.Radius.ui_points(ZONE_LINE)),
    )
    low, high, triangles = 0, len(ground) - 1, []
    while low + 1 < high:
        triangles.append([low, low + 1, high])
        if low + 1 < high - 1:
            triangles.append([low + 1, high - 1, high])
        low, high = low + 1, high - 1
    inside = rr.Mesh3D(
        vertex_positions=ground, triangle_indices=triangles, albedo_factor=[*color, ZONE_ALPHA]
    )
    rr.log(f"{EGO}/zone/inside", inside)


def log_sample(said: dict[str, Any], parts: list[bytes], colors: dict[str, list[int]]) -> None:
    """All that is known of one sample."""
    picture, points, point_colors = parts
    rr.set_time(TIMELINE, timestamp=np.datetime64(said["time_ns"], "ns"))
    rr.set_time("sample", sequence=said["sample_idx"])
    place(EGO, said["world_from_ego"])
    place(CAMERA, said["ego_from_camera"])
    width_px, height_px = said["size_px"]
    lens = rr.Pinhole(
        image_from_camera=said["image_from_camera"],
        resolution=[width_px, height_px],
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=3,
    )
    rr.log(CAMERA, lens)
    rr.log(f"{CAMERA}/image", rr.EncodedImage(contents=picture, media_type=said["media_type"]))
    cloud = np.frombuffer(points, dtype="<f4").reshape(-1, 3)
    shades = np.frombuffer(point_colors, dtype=np.uint8).reshape(-1, 3)
    rr.log(f"{EGO}/points", rr.Points3D(cloud, colors=shades, radii=rr.Radius.ui_points(POINT_SIZE)))
    if said["zone"] is not None:
        log_zone(said["zone"], colors["zone"])
    for kind, found in said["truth"].items():
        boxes(f"{EGO}/truth/{kind}", found, colors[kind.split("/")[0]], TRUTH_LINE)
    for harm, found in (said["predicted"] or {}).items():
        boxes(f"{EGO}/predicted/{harm}", found, colors[f"predicted_{harm}"], PREDICTED_LINE)
    for plot, lines in PLOTS.items():
        for key, _, _ in lines:
            if said[key] is not None:
                rr.log(f"plots/{plot}/{key}", rr.Scalars(round(said[key], 6)))


def blueprint() -> rrb.Blueprint:
    """The window: the camera over the plots on the left, the scene on the right."""
    behind = rrb.EyeControls3D(
        position=(-16, 0, 11), look_target=(12, 0, 0), eye_up=(0, 0, 1), tracking_entity=None
    )
    camera = rrb.Spatial2DView(
        name="Camera",
        origin=CAMERA,
        contents=["$origin/**", f"{EGO}/truth/**", f"{EGO}/predicted/**", f"{EGO}/zone/outline"],
    )
    plots = [rrb.TimeSeriesView(name=plot.capitalize(), origin=f"plots/{plot}") for plot in PLOTS]
    space = rrb.Spatial3DView(
        name="Space", origin=EGO, contents=["world/**", f"- {CAMERA}/**"], eye_controls=behind
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(camera, rrb.Grid(*plots, grid_columns=2), row_shares=[5, 4]),
            space,
            column_shares=[5, 6],
        ),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def main(out: str) -> None:
    """Write the recording."""
    told = messages(sys.stdin.buffer)
    header, (car_glb,) = next(told)
    # A viewer joins recordings of one id.
    rr.init("harmzone", recording_id=header["recording_id"])
    rr.save(out, default_blueprint=blueprint())
    rr.send_recording_name(header["episode"])
    log_header(header, car_glb)
    for said, parts in told:
        log_sample(said, parts, header["colors"])
    rr.disconnect()


if __name__ == "__main__":
    main(sys.argv[1])
