"""A detector without packages for `harmzone drive exec:`: one box round the points in the lane ahead.

With a word as argument it misbehaves from the third sample on: `dies`, `hangs`, `prints`. With `dawdles`
it takes half a second for each sample. With `wakes FOLDER`
it finds nothing where that folder is not there, and makes it: it drives so once, and otherwise from then on.
"""

import array
import json
import pathlib
import struct
import sys
import time

fault = sys.argv[1] if len(sys.argv) > 1 else ""
sleeps = False
if fault == "wakes":
    mark = pathlib.Path(sys.argv[2])
    sleeps = not mark.exists()
    mark.mkdir(exist_ok=True)
n_seen = 0


def read_message() -> bytes | None:
    length = sys.stdin.buffer.read(4)
    return sys.stdin.buffer.read(struct.unpack("<I", length)[0]) if len(length) == 4 else None


while (text := read_message()) is not None:
    header = json.loads(text)
    picture, cloud = read_message(), array.array("f")
    cloud.frombytes(read_message())
    assert picture[:2] == b"\xff\xd8" and len(cloud) == 5 * header["points"]["n"], "a JPEG and all points"
    n_seen += 1
    if n_seen == 3 and fault == "dies":
        sys.exit(7)
    if n_seen == 3 and fault == "hangs":
        time.sleep(3600)
    if n_seen == 3 and fault == "prints":
        print("loading weights ..", flush=True)
    if fault == "dawdles":
        time.sleep(0.5)
    rows = header["ego_from_lidar"]
    found = []
    for i in range(0, len(cloud), 5):
        point = [*cloud[i : i + 3], 1.0]
        x, y, z = (sum(a * b for a, b in zip(row, point, strict=True)) for row in rows[:3])
        ahead_m = x - header["front_bumper_x_m"]
        if 0 < ahead_m < 5 + 2 * header["speed_mps"] and abs(y) < 1.2 and 0.3 < z < 1.8:
            found.append((x, y, z))
    detections = []
    if len(found) > 5 and not sleeps:
        low = [min(point[k] for point in found) for k in range(3)]
        # The nearest metre of it is enough to stop before it.
        center = [low[0] + 0.5, low[1] + 0.5, 0.8]
        box = {"center_m": center, "size_m": [1.0, 1.0, 1.6], "yaw_rad": 0.0, "harm": "harmful", "score": 0.9}
        detections.append(box)
    answer = json.dumps({"detections": detections}).encode()
    sys.stdout.buffer.write(struct.pack("<I", len(answer)) + answer)
    sys.stdout.buffer.flush()
