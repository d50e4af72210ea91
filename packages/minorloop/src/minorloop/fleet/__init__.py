"""Many specimens at once: identify each from its record."""

from minorloop.fleet.identification import identify_fleet
from minorloop.fleet.manifest import Specimen, read_manifest
from minorloop.fleet.summary import Outcome, Summary

__all__ = ["Outcome", "Specimen", "Summary", "identify_fleet", "read_manifest"]
