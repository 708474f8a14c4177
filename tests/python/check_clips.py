"""Reads an MP4 with OpenCV and a GIF with Pillow, and sets their pictures beside those of a folder.

Usage: check_clips.py FOLDER MP4 GIF. All three are of the same samples; the folder holds the pictures as
they were drawn.
"""

import json
import sys
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

# Peak signal to noise, dB. An MP4 halves the resolution of colours, which thin lines lose by; a GIF has 255
# colours in all.
LEAST_DB = {"mp4": 28.0, "gif": 26.0}


def psnr_db(found: np.ndarray, wanted: np.ndarray) -> float:
    """How alike two pictures are, dB."""
    error = np.mean((found.astype(float) - wanted.astype(float)) ** 2)
    return 10 * float(np.log10(255**2 / max(error, 1e-9)))


def of_mp4(path: str) -> list[tuple[np.ndarray, float]]:
    """The pictures and the times at which they begin, ms."""
    reader = cv2.VideoCapture(path)
    pictures = []
    while True:
        is_there, picture = reader.read()
        begin_ms = reader.get(cv2.CAP_PROP_POS_MSEC)
        if not is_there:
            return pictures
        pictures.append((picture[:, :, ::-1], begin_ms))


def of_gif(path: str) -> list[tuple[np.ndarray, float]]:
    """As of an MP4; the GIF plays for ever."""
    with Image.open(path) as gif:
        assert gif.info["loop"] == 0
        pictures, begin_ms = [], 0.0
        for place in range(gif.n_frames):
            gif.seek(place)
            pictures.append((np.asarray(gif.convert("RGB")), begin_ms))
            begin_ms += gif.info["duration"]
        return pictures


def main(folder: str, mp4: str, gif: str) -> None:
    frames = json.loads((Path(folder) / "frames.json").read_text())
    wanted = [np.asarray(Image.open(Path(folder) / frame["file"]).convert("RGB")) for frame in frames]
    begins = np.concatenate([[0], np.cumsum([frame["duration_ms"] for frame in frames])])[:-1]
    for kind, found in (("mp4", of_mp4(mp4)), ("gif", of_gif(gif))):
        assert len(found) == len(wanted), f"{kind}: {len(found)} pictures, not {len(wanted)}"
        worst = np.inf
        for (picture, begin_ms), one, begin in zip(found, wanted, begins, strict=True):
            assert picture.shape == one.shape, f"{kind}: {picture.shape}, not {one.shape}"
            assert abs(begin_ms - begin) < 10, f"{kind}: at {begin_ms} ms, not {begin}"
            worst = min(worst, psnr_db(picture, one))
        assert worst > LEAST_DB[kind], f"{kind}: {worst:.1f} dB"
        print(f"{kind}: {len(found)} pictures, at least {worst:.1f} dB")


if __name__ == "__main__":
    main(*sys.argv[1:])
