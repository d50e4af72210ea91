"""``python -m minorloop`` is the command line."""

import sys

from minorloop.cli import main

sys.exit(main())
