"""The public names, for type checkers and for the package itself, which reads their homes here."""

from minorloop.connect import connect as connect
from minorloop.dynamics.cascade import Cascade as Cascade
from minorloop.dynamics.creep import Creep as Creep
from minorloop.dynamics.creep import fit_creep as fit_creep
from minorloop.dynamics.linear import Linear as Linear
from minorloop.dynamics.oscillator import Oscillator as Oscillator
from minorloop.dynamics.trajectory import Trajectory as Trajectory
from minorloop.errors import FleetError as FleetError
from minorloop.errors import InstrumentError as InstrumentError
from minorloop.errors import LimitError as LimitError
from minorloop.errors import MinorloopError as MinorloopError
from minorloop.errors import MissingExtraError as MissingExtraError
from minorloop.errors import ModelFileError as ModelFileError
from minorloop.errors import NotInvertibleError as NotInvertibleError
from minorloop.errors import OutputError as OutputError
from minorloop.errors import ParameterError as ParameterError
from minorloop.errors import RecordError as RecordError
from minorloop.errors import SafetyError as SafetyError
from minorloop.errors import SignalError as SignalError
from minorloop.errors import StoreError as StoreError
from minorloop.errors import UnreachableError as UnreachableError
from minorloop.figures import plot as plot
from minorloop.identification import AfterEffectIdentification as AfterEffectIdentification
from minorloop.identification import DynamicIdentification as DynamicIdentification
from minorloop.identification import Dynamics as Dynamics
from minorloop.identification import Gaussian as Gaussian
from minorloop.identification import Identification as Identification
from minorloop.identification import Plane as Plane
from minorloop.identification import Smooth as Smooth
from minorloop.identification import Viscosity as Viscosity
from minorloop.identification import excitation as excitation
from minorloop.identification import identify as identify
from minorloop.identification import read as read
from minorloop.identification.adaptive import Adaptive as Adaptive
from minorloop.identification.arx import arx as arx
from minorloop.identification.arx import step_response as step_response
from minorloop.identification.bands import Prediction as Prediction
from minorloop.identification.data_sheet import DataSheetModel as DataSheetModel
from minorloop.identification.data_sheet import from_loop as from_loop
from minorloop.identification.design import NextInput as NextInput
from minorloop.identification.design import design as design
from minorloop.identification.design import next_input as next_input
from minorloop.identification.frequency import Preamble as Preamble
from minorloop.identification.frequency import describing_function as describing_function
from minorloop.identification.frequency import frequency_response as frequency_response
from minorloop.identification.oscillator import Vibration as Vibration
from minorloop.identification.oscillator_result import (
    OscillatorIdentification as OscillatorIdentification,
)
from minorloop.identification.rational import fit_response as fit_response
from minorloop.identification.recursive import Recursive as Recursive
from minorloop.identification.representability import representability as representability
from minorloop.lab.actuator import Actuator as Actuator
from minorloop.lab.actuator import Channel as Channel
from minorloop.lab.curvature import curvature_from_displacement as curvature_from_displacement
from minorloop.lab.curvature import displacement_from_curvature as displacement_from_curvature
from minorloop.lab.plan import Plan as Plan
from minorloop.lab.records import Record as Record
from minorloop.lab.reduction import reduce as reduce
from minorloop.lab.run import run as run
from minorloop.lab.store import Setup as Setup
from minorloop.lab.store import Store as Store
from minorloop.modelfile import ModelWarning as ModelWarning
from minorloop.modelfile import load as load
from minorloop.modelfile import save as save
from minorloop.operators import densities as densities
from minorloop.operators.after_effect import AfterEffect as AfterEffect
from minorloop.operators.differential import BoucWen as BoucWen
from minorloop.operators.differential import Duhem as Duhem
from minorloop.operators.generalised_prandtl_ishlinskii import (
    GeneralisedPrandtlIshlinskii as GeneralisedPrandtlIshlinskii,
)
from minorloop.operators.inversion import Inversion as Inversion
from minorloop.operators.memory import Memory as Memory
from minorloop.operators.polynomial import Polynomial as Polynomial
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii as PrandtlIshlinskii
from minorloop.operators.preisach import Preisach as Preisach
from minorloop.operators.relays import RelayModel as RelayModel
from minorloop.operators.tracker import Tracker as Tracker
from minorloop.scoring import ModelScore as ModelScore
from minorloop.scoring import score as score
from minorloop.version import __version__ as __version__
