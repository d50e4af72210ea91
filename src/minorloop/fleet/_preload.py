"""What a worker needs, loaded once in the process from which local workers are forked.

Importing Dask and SciPy and loading the compiled loops takes a second or two; a process that is
forked afterwards begins with all of it.
"""

from __future__ import annotations

from contextlib import suppress

with suppress(Exception):  # a worker without it is slower to begin and says itself what is wrong
    import distributed  # noqa: F401

    from minorloop.fleet.identification import try_options

    try_options({"levels": 2, "prior": "none"})
