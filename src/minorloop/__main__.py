"""``python -m minorloop`` is the command line."""

import sys

if __name__ == "__main__":  # processes that are started import this module too
    from minorloop.cli import main

    sys.exit(main())
