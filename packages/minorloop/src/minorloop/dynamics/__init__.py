"""Linear dynamics around an operator."""

from minorloop.dynamics.cascade import Cascade, CascadeInversion, CascadeState
from minorloop.dynamics.creep import Creep, fit_creep
from minorloop.dynamics.linear import Linear
from minorloop.dynamics.oscillator import Oscillator
from minorloop.dynamics.trajectory import Trajectory

__all__ = [
    "Cascade",
    "CascadeInversion",
    "CascadeState",
    "Creep",
    "Linear",
    "Oscillator",
    "Trajectory",
    "fit_creep",
]
