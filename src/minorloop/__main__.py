"""The command line: ``minorloop`` and ``python -m minorloop``.

Processes that are started import this module too, so it imports the command line only when called.
"""

import sys


def main() -> int:
    """Run the command line; return its exit status."""
    from minorloop.cli import main as run

    return run()


if __name__ == "__main__":
    sys.exit(main())
