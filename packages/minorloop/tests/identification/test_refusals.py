"""What the estimators refuse, and the words in which they say so."""

from functools import cache, partial

import numpy as np
import pytest

from minorloop.dynamics.cascade import Cascade
from minorloop.dynamics.linear import Linear
from minorloop.dynamics.oscillator import Oscillator
from minorloop.errors import ParameterError, SignalError
from minorloop.identification import (
    Dynamics,
    Gaussian,
    Plane,
    Smooth,
    Viscosity,
    excitation,
    identify,
)
from minorloop.identification.adaptive import Adaptive, design_holds
from minorloop.identification.arx import arx, step_response
from minorloop.identification.design import design, next_input
from minorloop.identification.frequency import describing_function
from minorloop.identification.oscillator import Vibration
from minorloop.identification.pipeline import Options
from minorloop.identification.rational import fit_response
from minorloop.identification.recursive import Recursive
from minorloop.identification.representability import representability
from minorloop.identification.sine_response import Preamble, frequency_response, logged_periods
from minorloop.lab.records import Record
from minorloop.operators.differential import BoucWen
from minorloop.operators.memory import Memory
from minorloop.operators.preisach import Preisach
from minorloop.operators.relays import RelayModel

GRID = np.linspace(0, 1, 11)
PLANE = Preisach(np.linspace(-1, 1, 9), np.tril(np.random.default_rng(0).uniform(0, 1, (8, 8))))
STILL = RelayModel([2.0, 3.0], [[0.0, 0.0], [1.0, 0.0]])
NOW = Memory.after([0.0, 0.85, 0.3], low=0, high=1)

T = np.arange(1.0, 901)
STEP = np.where(T <= 300, 0.40, 0.45)
RISE = Linear.lags(27.0, 6.0).simulate(T, STEP, before=0.40)
GROWS = np.where(T < 301, 0.0, 1.02 ** np.minimum(T - 300, 600))
HERTZ = np.geomspace(0.005, 2, 12)
LAG = Linear.lags(0.5).response(HERTZ)

LOG = np.arange(400) / 100.0
SINE = np.sin(2 * np.pi * LOG)


def log(**change):
    return logged_periods(**{"t": LOG, "u": SINE, "y": SINE, "frequency": np.ones(400)} | change)


def response(drive=None, frequencies=(1.0,), operator=None, settling=1.0, **options):
    def plant(t, u):
        y = Cascade(PLANE, Linear.lags(0.1)).simulate(t, u, between="straight")
        return Record(u, y, 5.0 + t)

    known = {"preamble": Preamble(-1.0, 10.0), "settling": settling, "operator": operator}
    return frequency_response(drive or plant, frequencies, [0.5], **known | options)


@cache
def chosen(prior):
    u = np.linspace(0, 1, 5) ** 2
    return identify(u, u, Plane(4), prior=prior)


def in_time(change=None, **law):
    t = np.cumsum(np.repeat([0.1, 1.0], 30))
    u = np.repeat(np.random.default_rng(1008).uniform(-1, 1, 6), 10)
    return identify(Record(u, u, t if change is None else change(t)), Viscosity(**law))


def even(y=None, groups=None, **law):
    u = 50 - 50 * np.cos(np.arange(500) / 40)
    record = Record(u, u if y is None else y(u), np.arange(500) / 1000, groups=groups)
    return identify(record, Dynamics(**law))


MOVES = np.arange(2048) / 750
FORCE = 50 * np.sin(2 * np.pi * np.arange(2048) * 16 / 512) + 20 * np.sin(np.arange(2048) / 11)
PERIODIC = np.tile(FORCE[:512], 4)
SWINGS = 1e-4 * PERIODIC + 1e-3 * np.roll(PERIODIC, 3)
PLANT = Oscillator(2.0, 10.0, 5e4, BoucWen(5e4, 800.0, 900.0))
UNSTABLE = Oscillator(2.0, -1e5, 5e4, BoucWen(5e4, 800.0, 900.0))


def moved(rough=PLANT, y=SWINGS, t=MOVES, rows=2048, skip=0, **law):
    record = Record(PERIODIC[:rows], y[:rows], t[:rows], skip=skip)
    return identify(record, Vibration(rough, **law))


def gapped(y):
    return np.where(np.arange(y.size) % 10 == 0, y, np.nan)


def late(t):
    return np.where(np.arange(t.size) == 3, t[2], t)


UNUSABLE = [
    ("3 samples and y has 2", [0, 1, 2], [0, 1]),
    ("2 outputs are finite", [0, 1, 2, 3], [0, np.nan, np.nan, 1]),
    ("the input is 1 throughout", [1, 1, 1], [0, 1, 2]),
    (r"all 3 outputs are overload codes such as 9.9e\+37", [0, 1, 2], [9.9e37, 9.9e37, 9.9e37]),
    ("the output is 1 throughout", [0, 1, 2], [1, 1, 1]),
    ("u is nan at index 1", [0, np.nan, 2], [1, 2, 3]),
    ("give one record", [[0, 1, 2]], [[1, 2, 3]]),
    ("real numbers", ["a", "b", "c"], [1, 2, 3]),
    (r"changes only by 2\.22045e-16, at about 1, .* 25 bands", *[np.tile([1, 1 + 2**-52], 15)] * 2),
]
OPTIONS = [
    ("levels is 2.5; give a whole number", {"levels": 2.5}),
    ("sort", {"levels": [1, 0]}),
    ("relay is 'odd'; give", {"relay": "odd"}),
    ("slope is 'steep'; give", {"slope": "steep"}),
    ("holdout is 0.95; give", {"holdout": 0.95}),
    ("give one of them", {"prior": "gaussian", "smoothness": 0.1}),
    ("noise is -1.0; give a standard deviation >= 0", {"noise": -1.0}),
    ('cannot be combined with prior "none"', {"mean": "ridge", "prior": "none"}),
]
DEVIATIONS = [
    ("noise is -0.1 at index 0; give standard deviations >= 0", np.full(400, -0.1)),
]


def given(sd=None, **options):
    """Identify a record with options by their names."""
    return Options.of(options).identify(Record(LOG, LOG**2, sd=sd))


TOO_LARGE = [
    (SignalError, r"put reaches 1e[+-]307.*; scale it to", lambda f=f, u=u, y=y: f(T, u, y))
    for f in (arx, step_response)
    for scale in (1e307, 1e-307)
    for u, y in ((scale * STEP / 0.45, RISE), (STEP, scale * RISE / RISE.max()))
]
REFUSED = [
    *[(SignalError, words, partial(identify, u, y)) for words, u, y in UNUSABLE],
    *[(ParameterError, words, partial(given, **one)) for words, one in OPTIONS],
    *[(SignalError, words, partial(given, sd=sd)) for words, sd in DEVIATIONS],
    (ParameterError, "sort them", lambda: excitation.staircase([1.0, 0.0])),
    (SignalError, r"y \(3,\); give", lambda: representability([0, 1], [0, 1, 2])),
    (SignalError, "11 samples for up to 8", lambda: arx(T[290:310], STEP[290:310], RISE[290:310])),
    (SignalError, "nothing to identify", lambda: arx(T, STEP, np.ones(T.size))),
    (ParameterError, "at one interval", lambda: arx(T, STEP, RISE, second=(2 * T, STEP, RISE))),
    (SignalError, "no stable difference equation", lambda: arx(T, STEP, GROWS)),
    *TOO_LARGE,
    (ParameterError, "1 to 4", lambda: fit_response(HERTZ, LAG, order=5)),
    (ParameterError, "order is .best.; give", lambda: fit_response(HERTZ, LAG, order="best")),
    (SignalError, "shape", lambda: fit_response([1.0, 2.0], [1.0])),
    (SignalError, "remove its frequency", lambda: fit_response([1.0, 2.0], [1.0, 0.0])),
    (SignalError, "2 frequencies for 3 poles", lambda: fit_response([1, 2], [1, 0.5], order=3)),
    (SignalError, "gain reaches .*; scale it to below", lambda: fit_response(HERTZ, 1e307 * LAG)),
    (ParameterError, "give", lambda: Recursive(GRID, forgetting=0.0)),
    (ParameterError, "finite", lambda: Recursive(GRID).run(Recursive(GRID).begin(), np.nan, 0.0)),
    (ParameterError, "other levels", lambda: Recursive(GRID).begin(model=PLANE)),
    (ParameterError, "frequencies are .* give positive", lambda: response(frequencies=[0.0])),
    (ParameterError, "amplitude", lambda: describing_function(PLANE, 0.0)),
    (SignalError, "needed", lambda: response(lambda t, u: Record(u[:-400], u[:-400], t[:-400]))),
    (SignalError, "1 gap", lambda: response(lambda t, u: Record(u, np.append(u[1:], np.nan), t))),
    (
        SignalError,
        "several channels",
        lambda: response(lambda t, u: Record(np.array([u, u]), u, t, inputs=("a", "b"))),
    ),
    (SignalError, "does not", lambda: response(operator=STILL)),
    (SignalError, "no row with a positive frequency", lambda: log(frequency=np.zeros(400))),
    (SignalError, "1.2 periods and 2 whole periods", lambda: log(frequency=np.full(400, 0.3))),
    (SignalError, "10 samples in a period; give", lambda: log(frequency=np.full(400, 10.0))),
    (SignalError, "gaps in its last 2 periods", lambda: log(y=np.append(SINE[:-1], np.nan))),
    (ParameterError, "holds is 2", lambda: Adaptive(0.0, 1.0, holds=2)),
    (ParameterError, "least_gain is 1.5", lambda: Adaptive(0.0, 1.0, least_gain=1.5)),
    (ParameterError, r"give 0\.556 h or more", lambda: design_holds(None, 0.5, 200.0)),
    (ParameterError, "either in holds or in hours", lambda: design_holds(5, 1.0, 200.0)),
    (ParameterError, "holds is 2; give a whole number from 3 to 1000", lambda: design(GRID, 2)),
    (ParameterError, "memory is a list", lambda: next_input(chosen(Gaussian()), [0.0, 1.0])),
    (ParameterError, "needs the prior", lambda: next_input(chosen(Smooth()), NOW)),
    (
        SignalError,
        "ten times as fast",
        lambda: in_time(lambda t: np.arange(t.size), levels=4, rate=True),
    ),
    (SignalError, "t does not increase at index 3", lambda: in_time(late)),
    (ParameterError, "creep is 'slow'", lambda: in_time(creep="slow")),
    (
        ParameterError,
        "give fewer levels",
        lambda: in_time(levels=100, creep="spectrum", times=[1.0, 2.0]),
    ),
    (ParameterError, "lag cannot be combined with dynamics", lambda: even(plane=Plane(lag=3))),
    (ParameterError, 'poles is 4; give "auto" or 0 to 3', lambda: even(poles=4)),
    (ParameterError, "first is 'both'", lambda: even(first="both")),
    (ParameterError, r"groups .* cannot be combined", lambda: even(groups=np.zeros(500))),
    (SignalError, "50 outputs are fitted, and dynamics need 100", lambda: even(gapped)),
    (SignalError, "not a whole number of periods of 500", lambda: moved(period=500)),
    (SignalError, "the force differs between periods of 256", lambda: moved(period=256)),
    (SignalError, "no sample counts: skip is 2048, and the last", lambda: moved(skip=2048)),
    (SignalError, "evenly spaced", lambda: moved(t=np.where(MOVES > 1, MOVES + 0.1, MOVES))),
    (SignalError, "20 samples count for 7 parameters", lambda: moved(rows=20)),
    (ParameterError, "'weight'; give names out of mass", lambda: moved(fixed=["weight"])),
    (ParameterError, "rough is 'best'", lambda: moved("best")),
    (SignalError, "even if a spring ties it to the record", lambda: moved(UNSTABLE, period=512)),
]


@pytest.mark.parametrize(("error", "words", "make"), REFUSED)
def test_says_what_is_wrong(error, words, make):
    with pytest.raises(error, match=words):
        make()
