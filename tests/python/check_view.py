"""Checks a file of `harmzone view --mcap` and the layout for Foxglove with public packages alone.

Usage: check_view.py LAYOUT JOINED EPISODE LABELS DETECTIONS. Every topic that the layout names is in one of
the files, with a schema that its panel takes; each field of a plot or a table is in the messages; keys of
panels are those of Foxglove's own layout types.
"""

import dataclasses
import io
import json
import sys
from pathlib import Path

import foxglove.layouts as fl
import trimesh
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

PANELS = {"Image": fl.ImageConfig, "3D": fl.ThreeDeeConfig, "Plot": fl.PlotConfig, "Table": fl.TableConfig}
TOPIC_SETTINGS = {
    "foxglove.SceneUpdate": fl.BaseRendererSceneUpdateTopicSettings,
    "foxglove.PointCloud": fl.BaseRendererPointCloudTopicSettings,
}
# Of a panel of any kind; not a part of its own config.
TITLE = "foxglovePanelTitle"


def read(path: str) -> dict:
    """The messages of a file by topic, each with its time, and the schemas' names; every CRC is checked."""
    topics: dict[str, list] = {}
    schemas: dict[str, str] = {}
    with Path(path).open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()], validate_crcs=True)
        before = 0
        for schema, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            assert message.log_time >= before, "log times are in order"
            before = message.log_time
            schemas[channel.topic] = schema.name
            topics.setdefault(channel.topic, []).append((message.log_time, decoded))
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        assert summary.statistics.message_count == sum(map(len, topics.values()))
        assert all(chunk.compression == "zstd" for chunk in summary.chunk_indexes)
    return {"topics": topics, "schemas": schemas}


def keys_of(config: type) -> set[str]:
    """The keys that a panel's config may have."""
    fields = {
        field.name: None if field.default is dataclasses.MISSING else field.default
        for field in dataclasses.fields(config)
    }
    return set(config(**fields)._to_dict())


def check_keys(config: dict, of: type, where: str) -> None:
    """Refuses keys that the type of Foxglove does not have."""
    unknown = set(config) - keys_of(of) - {TITLE}
    assert not unknown, f"{where}: {of.__name__} has no {sorted(unknown)}"


def panels_in(part: dict | str) -> list[str]:
    """Names of the panels in a part of the window."""
    return [part] if isinstance(part, str) else panels_in(part["first"]) + panels_in(part["second"])


def check_space(config: dict, schemas: dict[str, str], where: str) -> set[str]:
    """Topics, camera and layers of a panel that draws in space."""
    for topic, settings in config["topics"].items():
        if topic in schemas:
            check_keys(settings, TOPIC_SETTINGS[schemas[topic]], f"{where} {topic}")
    if "cameraState" in config:
        check_keys(config["cameraState"], fl.ThreeDeeCameraState, where)
    check_keys(config["scene"], fl.BaseRendererSceneSettings, where)
    for layer in config["layers"].values():
        check_keys(layer, fl.BaseRendererGridLayerSettings, where)
    return set(config["topics"])


def value_at(message: object, path: str) -> object:
    """A field of a message, which must have it."""
    for name in path.split("."):
        assert name in message.DESCRIPTOR.fields_by_name, f"{message.DESCRIPTOR.name} has no {name}"
        message = getattr(message, name)
    return message


def check_layout(layout: dict, files: list[dict]) -> int:
    """The layout's panels, and what they name in the files."""
    schemas: dict[str, str] = {}
    for file in files:
        schemas |= file["schemas"]
    joined = files[0]["topics"]
    configs = layout["configById"]
    assert sorted(panels_in(layout["layout"])) == sorted(configs)
    named: set[str] = set()
    for name, config in configs.items():
        kind = name.split("!")[0]
        check_keys(config, PANELS[kind], name)
        if kind in ("Image", "3D"):
            named |= check_space(config, schemas, name)
        if kind == "Image":
            mode = config["imageMode"]
            check_keys(mode, fl.ImageModeConfig, name)
            assert schemas[mode["imageTopic"]] == "foxglove.CompressedImage"
            assert schemas[mode["calibrationTopic"]] == "foxglove.CameraCalibration"
            for topic in mode["annotations"]:
                assert schemas[topic] == "foxglove.ImageAnnotations", topic
            named |= {mode["imageTopic"], mode["calibrationTopic"], *mode["annotations"]}
        for series in config.get("paths", []):
            check_keys(series, fl.PlotSeries, name)
            topic, field = series["value"].split(".", 1)
            values = [value_at(message, field) for _, message in joined[topic]]
            assert all(isinstance(value, int | float) for value in values), series
            named.add(topic)
        if kind == "Table":
            topic, field = config["topicPath"].split(".", 1)
            assert any(len(value_at(message, field)) > 0 for _, message in joined[topic])
            named.add(topic)
    missing = {topic for topic in named if topic not in schemas}
    assert not missing, f"no file has {sorted(missing)}"
    return len(configs)


def check_drawings(joined: dict) -> int:
    """Nothing that is drawn outlives what it stands for; all of a sample is at one time."""
    topics = joined["topics"]
    times = [time for time, _ in topics["/ego/state"]]
    for topic, messages in topics.items():
        if topic.startswith("/view/") and topic != "/view/ego":
            assert [time for time, _ in messages] == times, topic
    objects = {time: {one.id for one in message.objects} for time, message in topics["/truth/objects"]}
    shown: set[str] = set()
    for time, update in topics["/view/boxes"]:
        ids = [entity.id for entity in update.entities]
        assert len(set(ids)) == len(ids), "ids are unique"
        shown = (shown - {deletion.id for deletion in update.deletions}) | set(ids)
        assert shown == objects[time], "what is shown is what is there"
        for entity in update.entities:
            assert entity.lifetime.seconds == entity.lifetime.nanos == 0
            assert entity.frame_id == "ego" and len(entity.cubes) == 1
    ((_, ego),) = topics["/view/ego"]
    model = ego.entities[0].models[0]
    assert model.media_type == "model/gltf-binary" and not model.url
    car = trimesh.load(io.BytesIO(model.data), file_type="glb", force="mesh")
    length, height, width = car.extents
    assert 3.9 < length < 4.3 and 1.4 < height < 1.7 and 1.6 < width < 2.2, car.extents
    return len(times)


def main(layout: str, paths: list[str]) -> None:
    files = [read(path) for path in paths]
    n_panels = check_layout(json.loads(Path(layout).read_text()), files)
    n_samples = check_drawings(files[0])
    print(f"{n_panels} panels, {len(files[0]['topics'])} topics, {n_samples} samples")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
