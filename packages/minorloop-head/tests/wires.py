"""Heated wires for tests: made-up ones, some identified on twins, and a loop around a twin."""

from datetime import UTC, datetime
from functools import cache

import numpy as np
import pytest

from minorloop import Preisach, excitation
from minorloop_head.control.heating import identify_heating, moving_levels
from minorloop_head.control.limits import WireLimits
from minorloop_head.heated_wire import HeatedWire
from minorloop_head.procedures.head_file import IdentifiedWires
from minorloop_head.twins.head import Head
from minorloop_head.twins.wire import Wire
from papers.catheter.control.laws import LAWS

TICK = 0.04
RIVALS = [pytest.param(name, marks=pytest.mark.whole) for name in LAWS if name != "observer"]
EVERY_LAW = pytest.mark.parametrize("name", ["observer", *RIVALS])
"""The law of the head, and with the whole tests its rivals in the paper."""


@cache
def made_up(bands=8, latent=2e-3, lag=4.0):
    """A wire with a loop half as wide as its plane."""
    levels = np.linspace(0.0, 0.16, bands + 1)

    def density(alpha, beta):
        return np.exp(-(((alpha - 0.1) / 0.02) ** 2) - ((beta - 0.07) / 0.02) ** 2)

    shape = Preisach.from_density(levels, density, relay="unipolar")
    weights = shape.weights * 60.0 / shape.weights.sum()
    return HeatedWire(Preisach(levels, weights, relay="unipolar"), lag, latent)


def settled(wire, currents, hold=40.0):
    """Settled angles of a twin of one wire after each of the holds."""
    return np.array([wire.apply(current, hold, hold).y[-1] for current in currents])


def angle(twin):
    """True angle of a twin of one wire, in degrees."""
    return float(twin._output_now()[0])


def temperature(twin):
    """True temperature of a twin of one wire, in degrees Celsius."""
    return float(twin._truth_now()[1][0])


@cache
def identified(bands=16, noise=0.05):
    """The nominal wire as a first loop, reversal curves and one step identify it."""
    twin = Wire(noise=noise, seed=1)
    loop = 0.4 * np.concatenate([np.linspace(0, 1, 25), np.linspace(1, 0, 25)[1:]])
    levels = moving_levels(loop, settled(twin, loop), bands)
    twin.reset()
    holds = excitation.reversal_curves(levels)
    angles = settled(twin, holds)
    twin.reset()
    t = np.arange(0.0, 40.0, 0.08)
    current = np.where((t >= 0.16) & (t < 25.0), 0.4, 0.0)
    y = [0.0] + [twin.apply(u, 0.08, 0.08).y[-1] for u in current[:-1]]
    return identify_heating(holds, angles, step=(t, current, np.array(y)), levels=levels)


@cache
def identified_head(seed):
    """Wires and coupling of one specimen, as its head is identified."""
    # Imported here: the studies import cameras too, and most tests of wires need none.
    from papers.catheter.head_static import identify_head

    return identify_head(seed)


def in_a_file(*wires, **changes):
    """What a file of a head has of its wires."""
    return IdentifiedWires(
        **{
            "on": datetime(2026, 1, 1, tzinfo=UTC),
            "wires": wires,
            "coupling": np.eye(2),
            "limits": WireLimits(),
            "highest": 0.4,
            "stores": {},
            **changes,
        }
    )


class Run:
    """A guarded loop around a twin of a head, with targets, currents, estimates and truth."""

    def __init__(self, control, reference, seconds, **options):
        options = {"noise": 0.05, "delay": TICK, "seed": 3, **options}
        head = Head(**options)
        state, y = control.begin(), np.zeros(2)
        steps = round(seconds / TICK)
        self.t = TICK * np.arange(1, steps + 1)
        self.wanted, self.true, self.current = (np.empty((steps, 2)) for _ in range(3))
        self.unreachable, self.believed = [], np.empty((steps, 2))
        for k in range(steps):
            self.wanted[k] = reference(k * TICK) if callable(reference) else reference
            u, state = control.step(state, self.wanted[k], y, t=k * TICK)
            y = head.exchange(u)
            self.current[k], self.true[k] = u, head._output_now()
            for axis, (guard, known) in enumerate(zip(control.axes, state.axes, strict=True)):
                self.believed[k, axis] = guard.temperature(known)
                if known.unreachable is not None:
                    self.unreachable.append((self.t[k], axis, known.unreachable))
        self.state, self.hottest = state, head._peaks()[0]

    @property
    def settling(self):
        """Time after which the first axis stays within 2 % or 0.3 degrees of the last target."""
        target = self.wanted[-1, 0]
        out = np.abs(self.true[:, 0] - target) > max(0.02 * abs(target), 0.3)
        return self.t[np.flatnonzero(out)[-1]] if out.any() else 0.0

    @property
    def overshoot(self):
        """Of the first axis, in percent of the last target."""
        return 100 * max((self.true[:, 0] / self.wanted[-1, 0]).max() - 1, 0.0)

    def error(self, after=0.0):
        """(T, 2) errors from a time on."""
        return (self.true - self.wanted)[self.t > after]
