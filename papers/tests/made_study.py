"""A study that takes no time, for tests of how its specimens are run; each in its own process."""

from types import SimpleNamespace

from papers.harness import Study


def run_study(seed):
    return SimpleNamespace(figures=lambda: {"steady": {"square": float(seed**2)}})


STUDY = Study("made", "A study", run_study)
