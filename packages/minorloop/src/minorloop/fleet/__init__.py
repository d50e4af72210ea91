"""Many specimens at once: identify each from its record, simulate millions together."""

from minorloop.fleet.identification import identify_fleet
from minorloop.fleet.manifest import Specimen, read_manifest
from minorloop.fleet.simulation import FleetState, simulate_fleet
from minorloop.fleet.summary import Outcome, Summary

__all__ = [
    "FleetState",
    "Outcome",
    "Specimen",
    "Summary",
    "identify_fleet",
    "read_manifest",
    "simulate_fleet",
]
