"""Counts a dataset anew from its decoded MCAP messages and compares with what `harmzone info --json` says.

Usage: check_info.py DATASET SET INFO.json. Prints one line of counts; exits 1 where anything differs.
"""

import json
import math
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

KINDS = {1: "vehicle", 2: "pedestrian", 3: "static"}
DISTRIBUTIONS = {1: "id", 2: "ood"}
HARMFUL = 1
# Quantity of the comparison -> how to take it from the boxes; the paper's figures stand in SPEC section 5.
PAPER_ID = {
    "harmful, all": 0.056,
    "harmful, vehicles": 0.107,
    "harmful, pedestrians": 0.055,
    "harmful, static": 0.020,
    "objects a sample": 6.7,
    "of all: vehicles": 0.38,
    "of all: pedestrians": 0.08,
    "of all: static": 0.55,
}
PAPER_OOD = {
    "harmful, ID objects": 0.047,
    "harmful, OOD objects": 0.060,
    "harmful, vehicles": 0.092,
    "harmful, pedestrians": 0.079,
    "objects a sample": 9.5,
    "OOD objects to one ID object": 0.40,
}


def messages(path: Path, topic: str) -> list:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        return [decoded for _, _, _, decoded in reader.iter_decoded_messages(topics=[topic])]


def boxes_of(dataset: Path, label_set: str, entry: dict) -> tuple[list[dict], list[dict]]:
    """The annotated boxes of an episode with their labels, and its samples."""
    episode = dataset / entry["file"]
    truths, states = messages(episode, "/truth/objects"), messages(episode, "/ego/state")
    labels = messages(dataset / "labels" / label_set / f"{entry['name']}.mcap", "/harm/labels")
    boxes, samples = [], []
    for truth, state, of_sample in zip(truths, states, labels, strict=True):
        place = {"split": entry["split"], "town": entry["town"], "weather": entry["weather"]}
        harms = {label.id: label.harm for label in of_sample.labels}
        samples.append(
            place
            | {
                "speed": state.speed_mps,
                "steering": math.degrees(state.steering_angle_rad),
                "n_objects": len(truth.objects),
            }
        )
        for item in truth.objects:
            boxes.append(
                place
                | {
                    "kind": KINDS[item.kind],
                    "distribution": DISTRIBUTIONS[item.distribution],
                    "category": item.category,
                    "range": math.hypot(item.x_m, item.y_m),
                    "points": item.n_lidar_points,
                    "visible": item.visible_fraction,
                    "is_harmful": harms[item.id] == HARMFUL,
                }
            )
    return boxes, samples


def share(part: list, whole: list) -> float | None:
    return len(part) / len(whole) if whole else None


def harmful_share(boxes: list[dict]) -> float | None:
    return share([box for box in boxes if box["is_harmful"]], boxes)


class Checker:
    """Notes where what info says and what was counted differ."""

    def __init__(self) -> None:
        self.wrong: list[str] = []

    def equal(self, what: str, found: object, wanted: object) -> None:
        if isinstance(found, float) and isinstance(wanted, float):
            is_equal = math.isclose(found, wanted, rel_tol=1e-12, abs_tol=1e-12)
        else:
            is_equal = found == wanted
        if not is_equal:
            self.wrong.append(f"{what}: info says {found!r}, counted {wanted!r}")

    def group(self, name: str, found: dict, boxes: list[dict], samples: list[dict], n_episodes: int) -> None:
        self.equal(f"{name}: episodes", found["n_episodes"], n_episodes)
        self.equal(f"{name}: samples", found["n_samples"], len(samples))
        self.equal(f"{name}: objects", found["n_objects"], len(boxes))
        self.equal(f"{name}: objects a sample", found["objects_per_sample"], share(boxes, samples))
        counts = Counter((box["distribution"], box["kind"], box["is_harmful"]) for box in boxes)
        for distribution in DISTRIBUTIONS.values():
            for kind in KINDS.values():
                harmful, harmless = (counts[distribution, kind, is_harmful] for is_harmful in (True, False))
                what = f"{name}: {distribution} {kind}"
                self.equal(what, found["objects"][distribution][kind], harmful + harmless)
                wanted = {"harmful": harmful, "harmless": harmless}
                self.equal(f"{what} labels", found["labels"][distribution][kind], wanted)
        shares = found["harmful_share"]
        self.equal(f"{name}: harmful, all", shares["all"], harmful_share(boxes))
        for key, values in (("kind", KINDS.values()), ("distribution", DISTRIBUTIONS.values())):
            for value in values:
                of_value = [box for box in boxes if box[key] == value]
                self.equal(f"{name}: harmful, {value}", shares[value], harmful_share(of_value))

    def histogram(self, name: str, found: dict, values: list[float]) -> None:
        edges = np.array(found["edges"])
        array = np.array(values, dtype=float)
        self.equal(f"{name}: counts", found["counts"], np.histogram(array, edges)[0].tolist())
        self.equal(f"{name}: below", found["n_below"], int((array < edges[0]).sum()))
        self.equal(f"{name}: above", found["n_above"], int((array > edges[-1]).sum()))
        self.equal(f"{name}: least", found["least"], float(array.min()))
        self.equal(f"{name}: most", found["most"], float(array.max()))


def quantities(boxes: list[dict], samples: list[dict]) -> dict[str, float | None]:
    def of(key: str, value: str) -> list[dict]:
        return [box for box in boxes if box[key] == value]

    plural = {"vehicle": "vehicles", "pedestrian": "pedestrians", "static": "static"}
    found = {
        "harmful, all": harmful_share(boxes),
        "harmful, ID objects": harmful_share(of("distribution", "id")),
        "harmful, OOD objects": harmful_share(of("distribution", "ood")),
        "objects a sample": share(boxes, samples),
        "OOD objects to one ID object": share(of("distribution", "ood"), of("distribution", "id")),
    }
    for kind, name in plural.items():
        found[f"harmful, {name}"] = harmful_share(of("kind", kind))
        found[f"of all: {name}"] = share(of("kind", kind), boxes)
    return found


def main() -> int:
    dataset, label_set = Path(sys.argv[1]), sys.argv[2]
    info = json.loads(Path(sys.argv[3]).read_text())
    manifest = json.loads((dataset / "dataset.json").read_text())
    entries = manifest["episodes"]
    boxes, samples = [], []
    for entry in entries:
        of_episode = boxes_of(dataset, label_set, entry)
        boxes += of_episode[0]
        samples += of_episode[1]
    check = Checker()
    check.equal("label set", info["label_set"], label_set)
    check.group("all", info, boxes, samples, len(entries))
    for key, groups in (("split", "splits"), ("town", "towns"), ("weather", "weathers")):
        check.equal(groups, sorted(info[groups]), sorted({entry[key] for entry in entries}))
        for value, found in info[groups].items():
            of_value = [[item for item in items if item[key] == value] for items in (boxes, samples)]
            n_episodes = sum(entry[key] == value for entry in entries)
            check.group(f"{key} {value}", found, *of_value, n_episodes)

    paper = PAPER_OOD if manifest["ood"] else PAPER_ID
    check.equal("compared", [row["quantity"] for row in info["comparison"]], list(paper))
    wanted = quantities(boxes, samples)
    for row in info["comparison"]:
        name = row["quantity"]
        here = wanted[name]
        check.equal(f"comparison, {name}", row["here"], here)
        check.equal(f"paper, {name}", row["paper"], paper[name])
        ratio = None if here is None else here / paper[name]
        check.equal(f"ratio, {name}", row["ratio"], ratio)
        is_within = None if ratio is None else 0.7 <= ratio <= 1.3
        check.equal(f"within, {name}", row["is_within_tolerance"], is_within)

    hardness = info["hardness"]
    occluded = [box for box in boxes if box["visible"] < 0.5]
    few = [box for box in boxes if box["points"] <= 10]
    check.equal("occluded", hardness["more_than_half_occluded"], share(occluded, boxes))
    check.equal("few points", hardness["ten_points_or_fewer"], share(few, boxes))
    check.equal("farthest", hardness["farthest_m"], max(box["range"] for box in boxes))
    n_bytes = sum((dataset / entry["file"]).stat().st_size for entry in entries)
    check.equal("bytes", info["n_bytes"], n_bytes)
    check.equal("bytes a sample", info["bytes_per_sample"], n_bytes / len(samples))

    categories = Counter((box["distribution"], box["kind"], box["category"]) for box in boxes)
    harmful = Counter(
        (box["distribution"], box["kind"], box["category"]) for box in boxes if box["is_harmful"]
    )
    found = {
        (item["distribution"], item["kind"], item["category"]): (item["n_objects"], item["n_harmful"])
        for item in info["categories"]
    }
    check.equal("categories", found, {key: (count, harmful[key]) for key, count in categories.items()})
    check.histogram("range", info["histograms"]["range_m"], [box["range"] for box in boxes])
    check.histogram("points", info["histograms"]["points_per_object"], [box["points"] for box in boxes])
    check.histogram("visible", info["histograms"]["visible_fraction"], [box["visible"] for box in boxes])
    check.histogram("speed", info["histograms"]["speed_mps"], [sample["speed"] for sample in samples])
    check.histogram("steering", info["histograms"]["steering_deg"], [s["steering"] for s in samples])
    check.histogram("objects", info["histograms"]["objects_per_sample"], [s["n_objects"] for s in samples])
    for line in check.wrong[:20]:
        print(line, file=sys.stderr)
    counts = f"{len(entries)} episodes, {len(samples)} samples, {len(boxes)} objects"
    print(f"{counts}, {len(check.wrong)} differences")
    return 1 if check.wrong or not boxes else 0


if __name__ == "__main__":
    sys.exit(main())
