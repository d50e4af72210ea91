"""From records to models."""

from minorloop.identification.after_effect import identify_after_effect
from minorloop.identification.after_effect_result import AfterEffectIdentification
from minorloop.identification.dynamic_result import DynamicIdentification
from minorloop.identification.dynamics import identify_dynamics
from minorloop.identification.fit import identify
from minorloop.identification.reading import read
from minorloop.identification.result import Identification

__all__ = [
    "AfterEffectIdentification",
    "DynamicIdentification",
    "Identification",
    "identify",
    "identify_after_effect",
    "identify_dynamics",
    "read",
]
