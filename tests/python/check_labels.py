"""Recomputes every label of a dataset's label set with shapely, from the decoded MCAP messages alone.

Usage: check_labels.py DATASET SET. Prints one line of counts; exits 1 at the first differences. `rect` must
be equal to 1e-9; the zones in zone_shapes.py are tried place by place, so what lies within a centimetre or
two of their edges may be called either.
"""

import json
import math
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from shapely.geometry import Polygon
from zone_shapes import check_arc, check_rss, check_ttc, is_above

TOLERANCE = 1e-9
HARMFUL, HARMLESS = 1, 2


def messages(path: Path, topic: str) -> dict[int, object]:
    """The topic's messages by log time in nanoseconds."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = {}
        for _, _, message, decoded in reader.iter_decoded_messages(topics=[topic]):
            assert message.log_time not in found, f"{path}: two messages of {topic} at {message.log_time}"
            found[message.log_time] = decoded
    return found


def zone_of(state: object, config: dict) -> Polygon:
    """The rectangle of SPEC section 3 for one ego state."""
    depth = config["time_gap_s"] * max(state.speed_mps, 0.0) + config["min_safe_distance_m"]
    sin, cos = math.sin(state.steering_angle_rad), math.cos(state.steering_angle_rad)
    half = config["width_m"] / 2
    x0 = state.front_bumper_x_m
    local = [(0, -half), (depth, -half), (depth, half), (0, half)]
    return Polygon([(x0 + u * cos - n * sin, u * sin + n * cos) for u, n in local])


def footprint_of(item: object) -> Polygon:
    """What is solid of an object, seen from above."""
    sin, cos = math.sin(item.yaw_rad), math.cos(item.yaw_rad)
    if item.HasField("solid"):
        part = item.solid
        along, across, length, width = part.along_m, part.across_m, part.length_m / 2, part.width_m / 2
    else:
        along, across, length, width = 0.0, 0.0, item.length_m / 2, item.width_m / 2
    signs = [(1, 1), (-1, 1), (-1, -1), (1, -1)]
    local = [(along + i * length, across + j * width) for i, j in signs]
    return Polygon([(item.x_m + a * cos - b * sin, item.y_m + a * sin + b * cos) for a, b in local])


def check_rect(state: object, objects: list, config: dict, written: object) -> list[str]:
    """What is wrong with the labels of one sample."""
    zone, wrong = zone_of(state, config), []
    corners = Polygon([(point.x_m, point.y_m) for point in written.zone])
    if corners.symmetric_difference(zone).area > 1e-6 or abs(corners.area - zone.area) > 1e-6:
        wrong.append("the zone's corners differ")
    for item, label in zip(objects, written.labels, strict=True):
        footprint = footprint_of(item)
        area = footprint.intersection(zone).area
        ratio = area / footprint.area
        is_met = area >= config["min_overlap_area_m2"] or ratio >= config["min_overlap_ratio"]
        is_harmful = is_met and not is_above(item, config)
        if label.harm != (HARMFUL if is_harmful else HARMLESS):
            wrong.append(f"`{item.id}` has harm {label.harm}, shapely says harmful: {is_harmful}")
        for name, got, want in [
            ("area", label.overlap_area_m2, area),
            ("ratio", label.overlap_ratio, ratio),
        ]:
            if not abs(got - want) <= TOLERANCE:
                wrong.append(f"`{item.id}` has {name} {got!r}, shapely says {want!r}")
    return wrong


CHECKS: dict[str, Callable] = {"rect": check_rect, "arc": check_arc, "ttc": check_ttc, "rss": check_rss}


def check_episode(episode: Path, labels: Path, config: dict) -> tuple[int, int, list[str]]:
    """Numbers of labels and of harmful ones, and what differs."""
    states, truths = messages(episode, "/ego/state"), messages(episode, "/truth/objects")
    written = messages(labels, "/harm/labels")
    wrong = []
    if not set(truths) == set(states) == set(written):
        wrong.append(f"{labels}: log times differ from the episode's")
    n_labels = n_harmful = 0
    for time in sorted(set(truths) & set(written)):
        if written[time].zone_name != config["kind"]:
            wrong.append(f"{labels} at {time}: the zone is called {written[time].zone_name}")
        if [item.id for item in truths[time].objects] != [label.id for label in written[time].labels]:
            wrong.append(f"{labels} at {time}: ids differ")
            continue
        found = CHECKS[config["kind"]](states[time], truths[time].objects, config, written[time])
        wrong += [f"{labels} at {time}: {line}" for line in found]
        n_labels += len(written[time].labels)
        n_harmful += sum(label.harm == HARMFUL for label in written[time].labels)
    return n_labels, n_harmful, wrong


def main() -> int:
    dataset, label_set = Path(sys.argv[1]), sys.argv[2]
    folder = dataset / "labels" / label_set
    config = tomllib.loads(json.loads((folder / "labels.json").read_text())["zone_toml"])
    entries = json.loads((dataset / "dataset.json").read_text())["episodes"]
    n_labels = n_harmful = 0
    wrong = []
    for entry in entries:
        episode = dataset / entry["file"]
        found = check_episode(episode, folder / f"{entry['name']}.mcap", config)
        n_labels, n_harmful, wrong = n_labels + found[0], n_harmful + found[1], wrong + found[2]
    for line in wrong[:20]:
        print(line, file=sys.stderr)
    print(f"{len(entries)} episodes, {n_labels} labels, {n_harmful} harmful, {len(wrong)} differences")
    return 1 if wrong or n_labels == 0 else 0


if __name__ == "__main__":
    sys.exit(main())
