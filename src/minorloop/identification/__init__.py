"""From records to models."""

from minorloop.identification.dynamic_result import DynamicIdentification
from minorloop.identification.dynamics import identify_dynamics
from minorloop.identification.fit import identify
from minorloop.identification.result import Identification

__all__ = ["DynamicIdentification", "Identification", "identify", "identify_dynamics"]
