"""The command line: ``minorloop`` and ``python -m minorloop``.

Processes that are started import this module too, so it imports the command line only when called.
"""

import sys

_INTERRUPTED = 130


def main() -> int:
    """Run the command line; return its exit status."""
    try:
        from minorloop.cli import main as run

        return run()
    except KeyboardInterrupt:  # while modules are loaded
        print("interrupted", file=sys.stderr)
        return _INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
