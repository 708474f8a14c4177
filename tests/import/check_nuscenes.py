"""Checks an export in nuScenes' format with the unmodified nuscenes-devkit, against the data set it was made
of.

Usage: check_nuscenes.py EXPORT DATA [--version v1.0-mini] [--labels rect] [--pictures DIR]
       [--predictions RESULT.json --metrics metrics.json --eval-set mini_val]

It loads the tables; compares each box, point, picture, calibration, CAN bus value and map pixel with the
episodes; lets `DetectionEval` score perfect boxes, which must give 1 for every class that has any; and, with
predictions, compares the devkit's scores with harmzone's. Exit code 1 on a difference.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from comparison import Comparison, angle_between, rotation_angle
from imported_episode import Episode, enum_name, read_data_set, read_messages
from nuscenes.can_bus.can_bus_api import NuScenesCanBus
from nuscenes.eval.common.config import config_factory
from nuscenes.eval.common.loaders import load_gt
from nuscenes.eval.detection.data_classes import DetectionBox
from nuscenes.eval.detection.evaluate import DetectionEval
from nuscenes.nuscenes import NuScenes
from nuscenes.utils.data_classes import LidarPointCloud
from nuscenes.utils.geometry_utils import transform_matrix
from nuscenes.utils.splits import create_splits_scenes
from pyquaternion import Quaternion

DISTANCES_M = (0.5, 1.0, 2.0, 4.0)  # of the detection task, detection_cvpr_2019
STEERING_RATIO = 15.2  # docs/real_logs.md: of the wheel's angle in the CAN bus to the road wheels'


def pose_of(nusc: NuScenes, data: dict, table: str) -> np.ndarray:
    """global_from_ego (`ego_pose`) or ego_from_sensor (`calibrated_sensor`) of a sample_data row."""
    row = nusc.get(table, data[f"{table}_token"])
    return transform_matrix(row["translation"], Quaternion(row["rotation"]))


def samples_of(nusc: NuScenes, scene: dict) -> list[dict]:
    """A scene's samples in order, by their links."""
    found, token = [], scene["first_sample_token"]
    while token:
        found.append(nusc.get("sample", token))
        token = found[-1]["next"]
    return found


def read_harms(data: Path, labels: str, name: str) -> list[dict[str, str]]:
    """Of each sample, the harm of each object by id; empty without labels."""
    path = data / "labels" / labels / f"{name}.mcap"
    if not path.exists():
        return []
    topics, _ = read_messages(path)
    return [
        {one.id: enum_name(one, "harm") for one in message.labels} for _, message in topics["/harm/labels"]
    ]


def delay_of(nusc: NuScenes, scene: dict, episode: Episode) -> int:
    """How much later than its episode a scene is, in microseconds."""
    first = nusc.get("sample", scene["first_sample_token"])
    return first["timestamp"] - episode.moments[0].time_ns // 1000


def check_scene(
    nusc: NuScenes, scene: dict, episode: Episode, harms: list[dict], categories: str, table: Comparison
) -> None:
    """Every sample of a scene."""
    samples = samples_of(nusc, scene)
    table.equal("samples of a scene", len(samples), len(episode.moments), scene["name"])
    # Scenes that would overlap in time are put off by whole hours.
    delay_us = delay_of(nusc, scene, episode)
    table.equal("whole hours", delay_us % 3_600_000_000, 0, scene["name"])
    for idx, (sample, moment) in enumerate(zip(samples, episode.moments, strict=False)):
        where = f"{scene['name']} {idx}"
        table.add("stamps", sample["timestamp"] - delay_us - moment.time_ns / 1000, 1.0, "us", where)
        lidar = nusc.get("sample_data", sample["data"]["LIDAR_TOP"])
        global_from_ego = pose_of(nusc, lidar, "ego_pose")
        ego_from_lidar = pose_of(nusc, lidar, "calibrated_sensor")
        cloud = LidarPointCloud.from_file(nusc.get_sample_data_path(lidar["token"]))
        table.add("LIDAR_TOP's x points right", ego_from_lidar[1, 0] + 1, 0.02, "", where)
        cloud.transform(ego_from_lidar)
        ours = moment.points_in_ego()
        table.equal("number of points", cloud.points.shape[1], len(ours), where)
        if cloud.points.shape[1] == len(ours):
            table.add("points, in order", np.linalg.norm(cloud.points[:3].T - ours, axis=1), 1e-4, "m", where)
            table.add("intensity", cloud.points[3] - moment.cloud["intensity"], 0.0, "", where)
            raw = np.fromfile(nusc.get_sample_data_path(lidar["token"]), dtype="<f4").reshape(-1, 5)
            table.add("ring", raw[:, 4] - moment.cloud["ring"], 0.0, "", where)
        shown = pose_of(nusc, lidar, "ego_pose") @ np.linalg.inv(moment.world_from_ego)
        table.add("ego's rotation", rotation_angle(shown[:3, :3], np.eye(3)), 1e-6, "rad", where)
        for name, camera in moment.cameras.items():
            data = nusc.get("sample_data", sample["data"][name.upper()])
            at = f"{where} {name}"
            picture = Path(nusc.get_sample_data_path(data["token"])).read_bytes()
            table.equal("picture bytes", picture, camera.image, at)
            table.equal(
                "picture size", (data["width"], data["height"]), (camera.width_px, camera.height_px), at
            )
            row = nusc.get("calibrated_sensor", data["calibrated_sensor_token"])
            k = np.array(row["camera_intrinsic"])
            shift = camera.k[0, 2] - k[0, 2]
            table.note(f"K's principal point: the episode's minus {shift:g} px")
            k[:2, 2] += round(shift * 2) / 2
            table.add("K", k - camera.k, 1e-6, "px", at)
            moved = np.linalg.inv(global_from_ego) @ pose_of(nusc, data, "ego_pose")
            camera_pose = moved @ pose_of(nusc, data, "calibrated_sensor")
            table.add("camera's pose", camera_pose - camera.ego_from_camera, 1e-6, "", at)
        boxes = {box.id: box for box in moment.boxes or []}
        table.equal("number of annotations", len(sample["anns"]), len(boxes), where)
        left = list(boxes.values())
        ego_from_global = np.linalg.inv(global_from_ego)
        for token in sample["anns"]:
            row, box = nusc.get("sample_annotation", token), nusc.get_box(token)
            in_ego = ego_from_global @ transform_matrix(box.center, box.orientation)
            if not left:
                break
            one = min(left, key=lambda b: np.linalg.norm(b.center_m - in_ego[:3, 3]))
            left.remove(one)
            at = f"{where} {one.category} {one.id}"
            table.add("box centres", in_ego[:3, 3] - one.center_m, 1e-6, "m", at)
            table.add("box sizes", box.wlh[[1, 0, 2]] - one.size_m, 1e-6, "m", at)
            yaw = np.arctan2(in_ego[1, 0], in_ego[0, 0])
            table.add("box yaws", angle_between(yaw, one.yaw_rad), 1e-6, "rad", at)
            table.add("points in boxes", row["num_lidar_pts"] - one.n_lidar_points, 0, "", at)
            velocity = (ego_from_global[:3, :3] @ nusc.box_velocity(token))[:2]
            if not (np.isnan(velocity).any() or np.isnan(one.velocity_mps).any()):
                # The devkit's is a difference over two sample intervals: an object that turns or starts
                # differs.
                table.add("velocities (devkit's differences)", velocity - one.velocity_mps, 8.0, "m/s", at)
            if categories.startswith("harm") and harms:
                harm = harms[idx][one.id].removeprefix("HARM_").lower()
                expected = {
                    "harm": harm,
                    "harm-as-car-truck": {"harmful": "vehicle.car"}.get(harm, "vehicle.truck"),
                }
                table.equal("category", row["category_name"], expected[categories], at)


def check_sweeps(nusc: NuScenes, scene: dict, episode: Episode, table: Comparison) -> None:
    """The LiDAR's files between the samples, by their links: times, poses and points."""
    samples = samples_of(nusc, scene)
    key_frame = nusc.get("sample_data", samples[0]["data"]["LIDAR_TOP"])
    global_from_map = pose_of(nusc, key_frame, "ego_pose") @ np.linalg.inv(episode.moments[0].world_from_ego)
    files, data = [], key_frame
    while data["next"]:
        data = nusc.get("sample_data", data["next"])
        files.append(data)
    found = [data for data in files if not data["is_key_frame"]]
    table.equal("key frames", len(files) - len(found) + 1, len(samples), scene["name"])
    table.equal("sweeps", len(found), len(episode.sweeps), scene["name"])
    for data, sweep in zip(found, episode.sweeps, strict=False):
        where = f"{scene['name']} {data['filename']}"
        stamp_us = data["timestamp"] - delay_of(nusc, scene, episode)
        table.add("stamps of sweeps", stamp_us - sweep.time_ns / 1000, 1.0, "us", where)
        after = nusc.get("sample", data["sample_token"])["timestamp"] > data["timestamp"]
        before = nusc.get("sample_data", data["prev"])["timestamp"] < data["timestamp"]
        table.equal("sweeps are of the sample that follows", (after, before), (True, True), where)
        cloud = LidarPointCloud.from_file(nusc.get_sample_data_path(data["token"])).points[:3].astype(float)
        turn = pose_of(nusc, data, "ego_pose") @ pose_of(nusc, data, "calibrated_sensor")
        ours = np.stack([sweep.cloud[axis] for axis in "xyz"]).astype(float)
        pose = global_from_map @ sweep.map_from_lidar
        off = turn[:3, :3] @ cloud + turn[:3, 3:] - pose[:3, :3] @ ours - pose[:3, 3:]
        table.add("points of sweeps, in order", off, 1e-4, "m", where)


def check_can_bus(nusc: NuScenes, export: Path, scenes: dict[str, Episode], table: Comparison) -> None:
    """Speed and steering of the CAN bus at the samples' times, through the devkit's reader."""
    bus = NuScenesCanBus(dataroot=str(export))
    for scene in nusc.scene:
        monitor = bus.get_messages(scene["name"], "vehicle_monitor")
        wheel = bus.get_messages(scene["name"], "steeranglefeedback")
        delay_us = delay_of(nusc, scene, scenes[scene["name"]])
        for moment in scenes[scene["name"]].moments:
            where, at_us = f"{scene['name']} {moment.time_ns}", moment.time_ns / 1000 + delay_us
            near = min(monitor, key=lambda row: abs(row["utime"] - at_us))
            table.add(
                "CAN bus speed", near["vehicle_speed"] / 3.6 - moment.state["speed_mps"], 1e-6, "m/s", where
            )
            near = min(wheel, key=lambda row: abs(row["utime"] - at_us))
            steering = near["value"] / STEERING_RATIO - moment.state["steering_angle_rad"]
            table.add("CAN bus steering", steering, 0.005, "rad", where)


def check_map(nusc: NuScenes, table: Comparison) -> None:
    """The ego stands on the drivable area of its map's mask, where the mask has one."""
    for one in nusc.map:
        mask = one["mask"].mask()
        if not mask.any():
            table.note("a map's mask is empty")
            continue
        on = []
        for scene in nusc.scene:
            if scene["log_token"] not in one["log_tokens"]:
                continue
            for sample in samples_of(nusc, scene):
                data = nusc.get("sample_data", sample["data"]["LIDAR_TOP"])
                x, y, _ = nusc.get("ego_pose", data["ego_pose_token"])["translation"]
                on.append(bool(one["mask"].is_on_mask(x, y)))
        table.add("egos beside the drivable area", 1 - np.mean(on), 0.05, "share", one["filename"])


def score(nusc: NuScenes, results: dict, eval_set: str) -> object:
    """DetectionEval's metrics with nuScenes' own config."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "results.json"
        path.write_text(json.dumps(results))
        evaluation = DetectionEval(
            nusc, config_factory("detection_cvpr_2019"), str(path), eval_set, folder, verbose=False
        )
        metrics, _ = evaluation.evaluate()
        counts = {}
        for box in evaluation.gt_boxes.all:
            counts[box.detection_name] = counts.get(box.detection_name, 0) + 1
        return metrics, counts


def check_perfect_boxes(nusc: NuScenes, table: Comparison) -> None:
    """The truth as predictions scores 1 in every class that has any."""
    names = {scene["name"] for scene in nusc.scene}
    for eval_set, scenes in create_splits_scenes().items():
        suits = {"v1.0-mini": ("mini_train", "mini_val"), "v1.0-trainval": ("train", "val"), "v1.0-test": ()}
        if eval_set not in suits[nusc.version] or not names & set(scenes):
            continue
        truth = load_gt(nusc, eval_set, DetectionBox, verbose=False)
        if not truth.all:
            table.note(f"{eval_set}: no box of the ten classes, nothing to score")
            continue
        results = {}
        for token in truth.sample_tokens:
            results[token] = [
                {
                    **box.serialize(),
                    "detection_score": 0.9,
                    "velocity": [0.0 if np.isnan(v) else float(v) for v in box.velocity],
                }
                for box in truth[token]
            ]
        meta = dict.fromkeys(("use_camera", "use_lidar", "use_radar", "use_map", "use_external"), False)
        metrics, counts = score(nusc, {"meta": meta, "results": results}, eval_set)
        for name in counts:
            ap = float(np.mean([metrics.get_label_ap(name, d) for d in DISTANCES_M]))
            table.add("AP of perfect boxes", 1 - ap, 1e-9, "", f"{eval_set} {name}")
            for kind in ("trans_err", "scale_err", "orient_err"):
                error = metrics.get_label_tp(name, kind)
                if not np.isnan(error):
                    table.add("errors of perfect boxes", error, 1e-6, "", f"{eval_set} {name} {kind}")
        table.note(f"{eval_set}: perfect boxes of {counts}")


def check_predictions(nusc: NuScenes, options: argparse.Namespace, table: Comparison) -> None:
    """The devkit's AP of harmful (car) and harmless (truck) are those of harmzone's metrics.json.

    The devkit knows no ignored ground. Where heaps are in view its mean is harmzone's strict figure, and none
    of its APs is above harmzone's own.
    """
    metrics, counts = score(nusc, json.loads(options.predictions.read_text()), options.eval_set)
    told = json.loads(options.metrics.read_text())
    ours, strict = told["per_threshold"]["total"], (told.get("strict") or {}).get("total")
    table.note(f"{options.eval_set}: scored truths {counts}")
    for harm, name in (("harmful", "car"), ("harmless", "truck")):
        for distance, found in zip(DISTANCES_M, ours[harm] or [], strict=False):
            theirs = metrics.get_label_ap(name, distance)
            table.note(f"AP {harm} at {distance} m: devkit {theirs:.6f}, harmzone {found}")
            more = (found or 0.0) - theirs
            # Ignored ground takes false positives away, no more.
            table.add(
                "AP against the devkit's",
                min(more, 0.0) if strict else more,
                1e-9,
                "",
                f"{harm} {distance} m",
            )
        if strict:
            theirs = float(np.mean([metrics.get_label_ap(name, distance) for distance in DISTANCES_M]))
            table.add("strict AP against the devkit's", (strict[harm] or 0.0) - theirs, 1e-9, "", harm)


def draw(nusc: NuScenes, folder: Path) -> None:
    """Pictures of a middle sample: points on the picture, boxes on the picture, boxes on the cloud from
    above.
    """
    import matplotlib

    matplotlib.use("agg")
    folder.mkdir(parents=True, exist_ok=True)
    best = max(nusc.sample, key=lambda sample: len(sample["anns"]))
    token = best["token"]
    nusc.render_pointcloud_in_image(
        token,
        pointsensor_channel="LIDAR_TOP",
        camera_channel="CAM_FRONT",
        out_path=str(folder / "points.png"),
    )
    for row in nusc.category:
        nusc.colormap.setdefault(row["name"], (255, 0, 0))  # the devkit knows its own names only
    nusc.render_sample_data(best["data"]["CAM_FRONT"], out_path=str(folder / "boxes.png"), verbose=False)
    # The devkit's drawing of the map needs numpy 1: `int` of an array of one number.
    with_map = np.__version__.startswith("1.")
    nusc.render_sample_data(
        best["data"]["LIDAR_TOP"], out_path=str(folder / "above.png"), verbose=False, underlay_map=with_map
    )


def main() -> int:
    """Runs all checks."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("export", type=Path)
    parser.add_argument("data", type=Path)
    parser.add_argument("--version", default="v1.0-mini")
    parser.add_argument("--labels", default="rect")
    parser.add_argument("--pictures", type=Path)
    parser.add_argument("--predictions", type=Path)
    parser.add_argument("--metrics", type=Path)
    parser.add_argument("--eval-set", default="mini_val")
    options = parser.parse_args()
    nusc = NuScenes(options.version, str(options.export), verbose=False)
    table = Comparison()
    categories = json.loads((options.export / "harmzone.json").read_text())["categories"]
    episodes = {episode.path.stem: episode for episode in read_data_set(options.data)}
    scenes = {scene["name"]: episodes[nusc.get("log", scene["log_token"])["logfile"]] for scene in nusc.scene}
    table.equal("scenes", len(nusc.scene), len(episodes), str(options.export))
    for scene in nusc.scene:
        episode = scenes[scene["name"]]
        harms = read_harms(options.data, options.labels, episode.path.stem)
        check_scene(nusc, scene, episode, harms, categories, table)
        if episode.sweeps:
            check_sweeps(nusc, scene, episode, table)
    check_can_bus(nusc, options.export, scenes, table)
    check_map(nusc, table)
    check_perfect_boxes(nusc, table)
    if options.predictions:
        check_predictions(nusc, options, table)
    if options.pictures:
        draw(nusc, options.pictures)
    return table.finish()


if __name__ == "__main__":
    sys.exit(main())
