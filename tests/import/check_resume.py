"""Kills an import again and again, lets it go on, and compares with one that ran through: the same files,
byte for byte.

Usage: check_resume.py HARMZONE FORMAT SRC [--kills N]
"""

from __future__ import annotations

import argparse
import hashlib
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def hashes(folder: Path) -> dict[str, str]:
    """SHA-256 of each file by its path in the folder."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def main() -> int:
    """Imports once whole, then in pieces."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("program", type=Path)
    parser.add_argument("format")
    parser.add_argument("source", type=Path)
    parser.add_argument("--kills", type=int, default=8)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        whole, pieces = Path(temporary, "whole"), Path(temporary, "pieces")
        command = [str(options.program.resolve()), "import", options.format, str(options.source.resolve())]
        start = time.monotonic()
        subprocess.run([*command, "--out", str(whole)], capture_output=True, check=True)
        needed_s = time.monotonic() - start
        for kill in range(options.kills):
            running = subprocess.Popen(
                [*command, "--out", str(pieces)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
            time.sleep(needed_s * (kill + 1) / (options.kills + 2))
            running.kill()
            running.wait()
            left = [path.name for path in pieces.rglob("*.mcap")] if pieces.exists() else []
            torn = [
                str(path)
                for path, found in (hashes(pieces) if pieces.exists() else {}).items()
                if path.endswith(".mcap") and found != hashes(whole)[path]
            ]
            print(f"killed {kill + 1}: {len(left)} episodes under their names, {len(torn)} of them torn")
            if torn:
                return 1
            if kill == options.kills // 2:
                shutil.rmtree(pieces, ignore_errors=True)
        done = subprocess.run([*command, "--out", str(pieces)], capture_output=True, text=True, check=True)
        same = hashes(pieces) == hashes(whole)
        print(done.stdout.strip().splitlines()[:3], "the same bytes" if same else "OTHER BYTES")
        if not same:
            one, other = hashes(whole), hashes(pieces)
            print({path for path in one.keys() | other.keys() if one.get(path) != other.get(path)})
        return int(not same)


if __name__ == "__main__":
    sys.exit(main())
