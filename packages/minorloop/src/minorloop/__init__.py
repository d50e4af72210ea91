"""Hysteresis of smart actuators: from measured data to precise positioning.

Every public name is here and is imported when it is first asked for, so that ``import
minorloop`` costs next to nothing.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

from minorloop.version import __version__

if TYPE_CHECKING:
    from minorloop.connect import connect
    from minorloop.dynamics.cascade import Cascade
    from minorloop.dynamics.creep import Creep, fit_creep
    from minorloop.dynamics.linear import Linear
    from minorloop.dynamics.oscillator import Oscillator
    from minorloop.dynamics.trajectory import Trajectory
    from minorloop.errors import (
        FleetError,
        InstrumentError,
        LimitError,
        MinorloopError,
        MissingExtraError,
        ModelFileError,
        NotInvertibleError,
        OutputError,
        ParameterError,
        RecordError,
        SafetyError,
        SignalError,
        StoreError,
        UnreachableError,
    )
    from minorloop.figures import plot
    from minorloop.identification import (
        AfterEffectIdentification,
        DynamicIdentification,
        Identification,
        excitation,
        identify,
        identify_after_effect,
        identify_dynamics,
        read,
    )
    from minorloop.identification.adaptive import Adaptive
    from minorloop.identification.arx import arx, step_response
    from minorloop.identification.bands import Prediction
    from minorloop.identification.data_sheet import DataSheetModel, from_loop
    from minorloop.identification.design import NextInput, design, next_input
    from minorloop.identification.frequency import Preamble, describing_function, frequency_response
    from minorloop.identification.oscillator import identify_oscillator
    from minorloop.identification.oscillator_result import OscillatorIdentification
    from minorloop.identification.rational import fit_response
    from minorloop.identification.recursive import Recursive
    from minorloop.identification.representability import representability
    from minorloop.lab.actuator import Actuator, Channel
    from minorloop.lab.curvature import curvature_from_displacement, displacement_from_curvature
    from minorloop.lab.logs import Log
    from minorloop.lab.plan import Plan
    from minorloop.lab.records import Record
    from minorloop.lab.reduction import reduce
    from minorloop.lab.run import run
    from minorloop.lab.store import Setup, Store
    from minorloop.modelfile import ModelWarning, load, save
    from minorloop.operators import densities
    from minorloop.operators.after_effect import AfterEffect
    from minorloop.operators.differential import BoucWen, Duhem
    from minorloop.operators.generalised_prandtl_ishlinskii import GeneralisedPrandtlIshlinskii
    from minorloop.operators.inversion import Inversion
    from minorloop.operators.memory import Memory
    from minorloop.operators.polynomial import Polynomial
    from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii
    from minorloop.operators.preisach import Preisach
    from minorloop.operators.relays import RelayModel
    from minorloop.operators.tracker import Tracker
    from minorloop.scoring import ModelScore, score


__all__ = [
    "Actuator",
    "Adaptive",
    "AfterEffect",
    "AfterEffectIdentification",
    "BoucWen",
    "Cascade",
    "Channel",
    "Creep",
    "DataSheetModel",
    "Duhem",
    "DynamicIdentification",
    "FleetError",
    "GeneralisedPrandtlIshlinskii",
    "Identification",
    "InstrumentError",
    "Inversion",
    "LimitError",
    "Linear",
    "Log",
    "Memory",
    "MinorloopError",
    "MissingExtraError",
    "ModelFileError",
    "ModelScore",
    "ModelWarning",
    "NextInput",
    "NotInvertibleError",
    "Oscillator",
    "OscillatorIdentification",
    "OutputError",
    "ParameterError",
    "Plan",
    "Polynomial",
    "PrandtlIshlinskii",
    "Preamble",
    "Prediction",
    "Preisach",
    "Record",
    "RecordError",
    "Recursive",
    "RelayModel",
    "SafetyError",
    "Setup",
    "SignalError",
    "Store",
    "StoreError",
    "Tracker",
    "Trajectory",
    "UnreachableError",
    "__version__",
    "arx",
    "connect",
    "curvature_from_displacement",
    "densities",
    "describing_function",
    "design",
    "displacement_from_curvature",
    "excitation",
    "fit_creep",
    "fit_response",
    "frequency_response",
    "from_loop",
    "identify",
    "identify_after_effect",
    "identify_dynamics",
    "identify_oscillator",
    "load",
    "next_input",
    "plot",
    "read",
    "reduce",
    "representability",
    "run",
    "save",
    "score",
    "step_response",
]

_HOMES = {
    "minorloop.lab.actuator": ("Actuator", "Channel"),
    "minorloop.identification.adaptive": ("Adaptive",),
    "minorloop.identification.bands": ("Prediction",),
    "minorloop.identification.data_sheet": ("DataSheetModel", "from_loop"),
    "minorloop.identification.design": ("NextInput", "design", "next_input"),
    "minorloop.dynamics.cascade": ("Cascade",),
    "minorloop.dynamics.creep": (
        "Creep",
        "fit_creep",
    ),
    "minorloop.dynamics.linear": ("Linear",),
    "minorloop.dynamics.oscillator": ("Oscillator",),
    "minorloop.identification.oscillator": ("identify_oscillator",),
    "minorloop.identification.oscillator_result": ("OscillatorIdentification",),
    "minorloop.operators.differential": ("BoucWen", "Duhem"),
    "minorloop.dynamics.trajectory": ("Trajectory",),
    "minorloop.identification.arx": (
        "arx",
        "step_response",
    ),
    "minorloop.identification.frequency": (
        "Preamble",
        "describing_function",
        "frequency_response",
    ),
    "minorloop.identification.rational": ("fit_response",),
    "minorloop.identification.recursive": ("Recursive",),
    "minorloop.identification.representability": ("representability",),
    "minorloop.lab.plan": ("Plan",),
    "minorloop.lab.run": ("run",),
    "minorloop.lab.store": (
        "Setup",
        "Store",
    ),
    "minorloop.connect": ("connect",),
    "minorloop.figures": ("plot",),
    "minorloop.errors": (
        "FleetError",
        "InstrumentError",
        "LimitError",
        "MinorloopError",
        "MissingExtraError",
        "ModelFileError",
        "NotInvertibleError",
        "OutputError",
        "ParameterError",
        "RecordError",
        "SafetyError",
        "SignalError",
        "StoreError",
        "UnreachableError",
    ),
    "minorloop.identification": (
        "AfterEffectIdentification",
        "DynamicIdentification",
        "Identification",
        "identify",
        "identify_after_effect",
        "identify_dynamics",
        "read",
    ),
    "minorloop.lab.curvature": ("curvature_from_displacement", "displacement_from_curvature"),
    "minorloop.lab.logs": ("Log",),
    "minorloop.lab.records": ("Record",),
    "minorloop.lab.reduction": ("reduce",),
    "minorloop.modelfile": ("ModelWarning", "load", "save"),
    "minorloop.operators.after_effect": ("AfterEffect",),
    "minorloop.operators.generalised_prandtl_ishlinskii": ("GeneralisedPrandtlIshlinskii",),
    "minorloop.operators.inversion": ("Inversion",),
    "minorloop.operators.memory": ("Memory",),
    "minorloop.operators.polynomial": ("Polynomial",),
    "minorloop.operators.prandtl_ishlinskii": ("PrandtlIshlinskii",),
    "minorloop.operators.preisach": ("Preisach",),
    "minorloop.operators.relays": ("RelayModel",),
    "minorloop.operators.tracker": ("Tracker",),
    "minorloop.scoring": ("ModelScore", "score"),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}
_MODULES = {
    "densities": "minorloop.operators.densities",
    "excitation": "minorloop.identification.excitation",
}
_MEANT = {
    **dict.fromkeys(("fit", "train", "calibrate", "learn"), "identify"),
    **dict.fromkeys(("predict", "forward"), "identify(...).predict, or simulate of a model"),
    **dict.fromkeys(("simulate", "invert", "inverse"), "the method of a model, such as Preisach"),
    **dict.fromkeys(("read_csv", "open"), "read, or load for a model file"),
    **dict.fromkeys(("validate", "evaluate", "test"), "score"),
    "measure": "run",
}


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(_MODULES[name])
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    hint = f"; did you mean {_MEANT[name]}?" if name in _MEANT else ""
    raise AttributeError(f"module 'minorloop' has no attribute {name!r}{hint}")


def __dir__() -> list[str]:
    return sorted(__all__)


class _Package(ModuleType):
    """A package in which ``connect`` is the function, not the module of the same name.

    Importing a submodule binds its name in the package; without this, what
    ``minorloop.connect`` is would depend on what was imported before.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if name == "connect" and isinstance(value, ModuleType):
            value = value.connect
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
