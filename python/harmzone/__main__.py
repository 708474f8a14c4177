"""The command `harmzone`, also as `python -m harmzone`."""

import signal
import sys

from harmzone import _native


def main() -> None:
    """Run the program on the process's arguments; it ends the process."""
    # What the program starts for its `--engine ray`.
    if sys.argv[1:] == ["ray-engine"]:
        from harmzone.ray import _engine

        _engine.main()
        return
    # As any program: Python's own handler would wait until the work in Rust is over.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    _native.main(sys.argv[1:])


if __name__ == "__main__":
    main()
