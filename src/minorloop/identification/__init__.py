"""From records to models."""

from minorloop.identification.fit import identify
from minorloop.identification.result import Identification

__all__ = ["Identification", "identify"]
