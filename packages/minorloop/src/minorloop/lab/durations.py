"""Durations as text."""


def as_duration(seconds: float) -> str:
    """Return a duration in seconds, minutes or hours, whichever suits."""
    if seconds < 90:
        return f"{seconds:.3g} s"
    if seconds < 3600:
        return f"{round(seconds / 60, 1):g} min"
    return f"{round(seconds / 3600, 1):g} h"
