"""A study that takes no time, for tests of how its specimens are run; each in its own process."""

from types import SimpleNamespace

TITLE, CLAIMS = "A study", ()


def run_study(seed):
    return SimpleNamespace(figures=lambda: {"steady": {"square": float(seed**2)}})
