"""From records to models."""

from minorloop.identification.after_effect import Viscosity
from minorloop.identification.after_effect_result import AfterEffectIdentification
from minorloop.identification.dynamic_result import DynamicIdentification
from minorloop.identification.dynamics import Dynamics
from minorloop.identification.fit import Plane
from minorloop.identification.pipeline import identify
from minorloop.identification.plane_result import Identification
from minorloop.identification.prior import Gaussian, Smooth
from minorloop.identification.reading import read
from minorloop.identification.result import Fit

__all__ = [
    "AfterEffectIdentification",
    "DynamicIdentification",
    "Dynamics",
    "Fit",
    "Gaussian",
    "Identification",
    "Plane",
    "Smooth",
    "Viscosity",
    "identify",
    "read",
]
