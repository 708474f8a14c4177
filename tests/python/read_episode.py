"""Reads an episode and its labels with the public MCAP and protobuf packages and prints what it found.

Usage: read_episode.py EPISODE LABELS. Knows nothing of harmzone: schemas come from the files.
"""

import json
import struct
import sys
from pathlib import Path

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory


def read(path: str) -> dict:
    """Every message of a file by topic, decoded, with its log time; and the metadata records."""
    topics: dict[str, list] = {}
    schemas: dict[str, str] = {}
    with Path(path).open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()], validate_crcs=True)
        header = reader.get_header()
        assert header.profile == "", header.profile
        assert header.library.startswith("harmzone "), header.library
        before = 0
        for schema, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):
            assert channel.message_encoding == "protobuf" and schema.encoding == "protobuf"
            assert message.log_time >= before, "log times are in order"
            assert message.publish_time == message.log_time
            before = message.log_time
            schemas[channel.topic] = schema.name
            topics.setdefault(channel.topic, []).append((message.log_time, decoded))
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None
        assert all(chunk.compression == "zstd" for chunk in summary.chunk_indexes)
        n_messages = sum(len(messages) for messages in topics.values())
        assert summary.statistics.message_count == n_messages
        metadata = {record.name: dict(record.metadata) for record in reader.iter_metadata()}
    return {"topics": topics, "schemas": schemas, "metadata": metadata}


def time_ns(timestamp) -> int:
    """A message's own timestamp in nanoseconds."""
    return timestamp.seconds * 1_000_000_000 + timestamp.nanos


def enum_name(message, field: str) -> str:
    """The name of an enum field's value."""
    descriptor = message.DESCRIPTOR.fields_by_name[field]
    return descriptor.enum_type.values_by_number[getattr(message, field)].name


def points(cloud) -> list:
    """The points of a foxglove.PointCloud, unpacked by its own field table."""
    codes = {3: "H", 7: "f"}
    table = [(field.name, field.offset, "<" + codes[field.type]) for field in cloud.fields]
    assert len(cloud.data) % cloud.point_stride == 0
    starts = range(0, len(cloud.data), cloud.point_stride)
    return [
        {name: struct.unpack_from(code, cloud.data, at + offset)[0] for name, offset, code in table}
        for at in starts
    ]


def transform(one) -> list:
    """Parent, child, translation and rotation (x, y, z, w)."""
    t, r = one.translation, one.rotation
    return [one.parent_frame_id, one.child_frame_id, [t.x, t.y, t.z], [r.x, r.y, r.z, r.w]]


def cubes(update) -> list:
    """Id, frame, lifetime and size of each entity's cube."""
    found = []
    for entity in update.entities:
        (cube,) = entity.cubes
        lifetime_ns = time_ns(entity.lifetime)
        found.append([entity.id, entity.frame_id, lifetime_ns, [cube.size.x, cube.size.y, cube.size.z]])
    return found


def plain(message) -> dict:
    """A message's scalar fields and its solid part, enums by name; optional ones where they are set."""
    values = {}
    for field in message.DESCRIPTOR.fields:
        if field.has_presence and not message.HasField(field.name):
            continue
        if field.enum_type is not None:
            values[field.name] = enum_name(message, field.name)
        elif field.message_type is None:
            values[field.name] = getattr(message, field.name)
        elif field.message_type.name == "SolidPart":
            values[field.name] = plain(getattr(message, field.name))
    return values


def main(episode_path: str, labels_path: str) -> None:
    episode, labels = read(episode_path), read(labels_path)
    samples = []
    topics = episode["topics"]
    each_sample = [topic for topic in topics if topic != "/map"]
    ((map_time, town_map),) = topics["/map"]
    for i, (log_time, state) in enumerate(topics["/ego/state"]):
        now = {}
        for topic in each_sample:
            at, now[topic] = topics[topic][i]
            assert at == log_time, f"{topic}: all messages of a sample carry the same log time"
        for topic in labels["topics"]:
            at, now[topic] = labels["topics"][topic][i]
            assert at == log_time, f"{topic}: labels lie at the sample's log time"
        for topic, message in now.items():
            if "timestamp" in message.DESCRIPTOR.fields_by_name:
                assert time_ns(message.timestamp) == log_time, topic
        image, camera, pose = (
            now["/cam_front/image_rect_compressed"],
            now["/cam_front/camera_info"],
            now["/ego/pose"],
        )
        harm = now["/harm/labels"]
        (zone,) = now["/harm/zone"].entities
        assert zone.lines[0].points and zone.triangles[0].indices
        samples.append(
            {
                "time_ns": log_time,
                "state": plain(state),
                "tf": [transform(one) for one in now["/tf"].transforms],
                "pose": [pose.frame_id, [pose.pose.position.x, pose.pose.position.y, pose.pose.position.z]],
                "image": [image.frame_id, image.format, list(image.data)],
                "camera": [
                    camera.frame_id,
                    camera.width,
                    camera.height,
                    list(camera.K),
                    list(camera.P),
                    list(camera.D),
                ],
                "lidar": [now["/lidar_top"].frame_id, points(now["/lidar_top"])],
                "objects": [plain(one) for one in now["/truth/objects"].objects],
                "ignored": [
                    [[p.x_m, p.y_m] for p in one.ground.corners] for one in now["/truth/ignored"].regions
                ],
                "markers": cubes(now["/truth/markers"]),
                "harm_objects": cubes(now["/harm/objects"]),
                "zone_name": harm.zone_name,
                "zone": [[corner.x_m, corner.y_m] for corner in harm.zone],
                "zone_frame": zone.frame_id,
                "labels": [plain(one) for one in harm.labels],
                "annotations": [[p.type, len(p.points)] for p in now["/cam_front/harm_annotations"].points],
            }
        )
    entities = {entity.id: entity for entity in town_map.entities}
    result = {
        "schemas": episode["schemas"] | labels["schemas"],
        "metadata": episode["metadata"] | labels["metadata"],
        "map": {
            "time_ns": map_time,
            "frames": sorted({entity.frame_id for entity in town_map.entities}),
            "lines": [[[p.x, p.y, p.z] for p in line.points] for line in entities["lane_lines"].lines],
            "area": [[p.x, p.y, p.z] for p in entities["drivable_area"].triangles[0].points],
        },
        "samples": samples,
    }
    print(json.dumps(result, allow_nan=False))


if __name__ == "__main__":
    main(*sys.argv[1:])
