"""A detector for `harmzone drive exec:`, in PyTorch: what stands out of the road ahead is harmful.

harmzone drive blind truth "exec:python3 examples/drive_detector.py" --ood --out drives
"""

import json
import struct
import sys

import torch

CELL_M = 0.8  # points of one cell are one box


def read_message() -> bytes | None:
    """The next message: its length, then its bytes; None at the end."""
    length = sys.stdin.buffer.read(4)
    return sys.stdin.buffer.read(struct.unpack("<I", length)[0]) if len(length) == 4 else None


def detect(header: dict, points: torch.Tensor) -> list[dict]:
    """Boxes of the points [point, 5] that lie where the ego will be in two seconds, between knee and roof."""
    ego_from_lidar = torch.tensor(header["ego_from_lidar"])
    in_ego = points[:, :3] @ ego_from_lidar[:3, :3].T + ego_from_lidar[:3, 3]
    ahead_m = in_ego[:, 0] - header["front_bumper_x_m"]
    is_near = (ahead_m > 0) & (ahead_m < 5 + 2 * header["speed_mps"]) & (in_ego[:, 1].abs() < 1.5)
    found = in_ego[is_near & (in_ego[:, 2] > 0.3) & (in_ego[:, 2] < 2.0)]
    cells, members = torch.unique((found[:, :2] / CELL_M).floor(), dim=0, return_inverse=True)
    boxes = []
    for cell in range(len(cells)):
        own = found[members == cell]
        low, high = own.min(0).values, own.max(0).values
        size = (high - low).clamp(min=0.2).tolist()
        found_box = {"center_m": ((low + high) / 2).tolist(), "size_m": size, "yaw_rad": 0.0}
        boxes.append({**found_box, "harm": "harmful", "score": min(1.0, len(own) / 10)})
    return boxes


while (text := read_message()) is not None:
    picture, cloud = read_message(), read_message()
    points = torch.frombuffer(bytearray(cloud or 20), dtype=torch.float32).reshape(-1, 5)
    answer = json.dumps({"detections": detect(json.loads(text), points)}).encode()
    sys.stdout.buffer.write(struct.pack("<I", len(answer)) + answer)
    sys.stdout.buffer.flush()
