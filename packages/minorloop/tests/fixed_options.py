"""`identify` with which nothing is compared, for tests of a single fit."""

from minorloop import Record, identification
from minorloop.identification import pipeline

FIXED = {"diagonal": "uniform", "slope": False, "lag": 0}


def Plane(levels=25, **options):
    return identification.Plane(levels, **FIXED | options)


def identify(u, y=None, law=None, **options):
    if isinstance(u, Record):
        return identification.identify(u, y or law or Plane(), **options)
    return identification.identify(u, y, law or Plane(), **options)


class Options:
    """Options by name, as front ends have them."""

    @staticmethod
    def of(options):
        return pipeline.Options.of({"levels": 25, **FIXED, **options})
