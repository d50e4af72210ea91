"""A nickel-titanium wire against a spring, heated by a current: an actuator of the head.

A current heats the wire. When hot, it transforms from martensite to austenite, shortens and turns a
pulley against a spring; when cold, the spring pulls it out again. Stress shifts the temperatures of
the transformation, and heating and cooling take different paths: this is the hysteresis. The model
contains no Preisach operator.

Channels: ``current`` in A, 0 to 0.4, in; ``angle`` in degrees, 0 when cold, about 60 at 0.4 A,
out. A command u of the catheter paper, 0 to 1.2 V, is the current u * 0.4 / 1.2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray, as_finite, check_kind
from minorloop.errors import ParameterError
from minorloop.lab.actuator import Channel
from minorloop_head.twins import _wire_kernels as _kernels
from minorloop_head.twins.sensor import SimulatedFault
from minorloop_head.twins.simulated_axes import SimulatedAxes
from minorloop_head.twins.surroundings import Surroundings

HIGHEST_CURRENT = 0.4
DIAMETER = 0.2e-3
"""Diameter in m, equal for all specimens: it sets resistance and surface, and is drawn to 1 %."""

WIRE = {
    "density": 6450.0,  # kg/m^3
    "heat_capacity": 837.0,  # J/(kg K)
    "latent_heat": 24.2e3,  # J/kg
    "resistivity_martensite": 0.8e-6,  # ohm m
    "resistivity_austenite": 1.0e-6,
    "length": 0.070,  # m
    "recoverable_strain": 0.045,
    "modulus_austenite": 67.0e9,  # Pa
    "modulus_martensite": 26.3e9,
    "stress_influence": 8.0e6,  # Pa/K
    "austenite_start": 45.0,  # degrees Celsius, without stress
    "austenite_finish": 75.0,
    "martensite_start": 58.0,
    "martensite_finish": 30.0,
    "preload": 2.2,  # N
    "spring": 2500.0,  # N/m
    "pulley": 2.87e-3,  # m
}


class HeatedWires(SimulatedAxes):
    """Wires, each heated by its own current, in the same surroundings.

    ``surroundings``: ambient, convection and load over time; still air at 20 degrees without it.
    ``ageing``: used share of the life of the wires. At 1 they have lost 10 % of their stroke, at
    the hot end, and all their transformations need 5 K more. ``drift``: increase of the ageing per
    hour. ``specimen``, ``noise``, ``seed``, ``tick``, ``delay``, ``faults``, ``substeps``,
    ``log_truth``: as in ``SimulatedAxes``.
    """

    _farthest = 180.0
    _truth_names = ("angle", "temperature", "stress", "martensite", "body")

    def __init__(
        self,
        specimen: int | None = None,
        noise: float = 0.0,
        seed: int = 0,
        *,
        tick: float = 0.04,
        delay: float = 0.0,
        surroundings: Surroundings | None = None,
        ageing: float = 0.0,
        drift: float = 0.0,
        faults: Sequence[SimulatedFault] = (),
        substeps: int = 1,
        log_truth: bool = False,
    ) -> None:
        self.surroundings = Surroundings() if surroundings is None else surroundings
        check_kind("surroundings", self.surroundings, Surroundings)
        self.ageing, self.drift = as_finite("ageing", ageing), as_finite("drift", drift)
        for name, value in (("ageing", self.ageing), ("drift", self.drift)):
            if not 0 <= value <= 1:
                raise ParameterError(f"{name} is {value}; give 0 to 1, a share of a wire's life")
        self.surround(self.surroundings)
        self._age = np.array([self.ageing, self.drift / 3600.0])
        super().__init__(
            specimen,
            noise,
            seed,
            tick=tick,
            delay=delay,
            faults=faults,
            substeps=substeps,
            log_truth=log_truth,
        )

    def surround(self, surroundings: Surroundings) -> None:
        """Replace the surroundings from now on, such as when a pipe is flooded.

        ``surroundings``: over the clock of the twin, which continues.
        """
        self.surroundings = surroundings
        self._around = surroundings.courses()
        self._loads = surroundings.loads(len(self.outputs))
        self._cooling = surroundings.cooling_numbers()

    def reset(self) -> None:
        """Go back to the start: cold wires, clock at 0, the noise from its beginning."""
        self._cross = self._coupling()
        offset = -float(self._cross[3] * self._cross[4])
        self._axes = np.array([wire_numbers(each, offset) for each in self._wires()])
        super().reset()

    def _wires(self) -> list[dict[str, float]]:
        """Return the parameters of each wire."""
        raise NotImplementedError

    def _coupling(self) -> FloatArray:
        """Return the coupling of the axes, (5,); see ``_wire_kernels.head_run``."""
        raise NotImplementedError

    def _at_rest(self) -> FloatArray:
        state: FloatArray = _kernels.heads_at_rest(
            self._axes, self._cross, self._around, self._loads, self.ageing
        )
        return state

    def _run(self, ends: FloatArray, first: FloatArray, u: FloatArray) -> FloatArray:
        out: FloatArray = _kernels.head_run(
            self._state, self._axes, self._cross, self._around, self._loads, self._cooling,
            self._age, self._clock, ends, first, u, self._pace, self.delay, self._past, self._mark,
        )  # fmt: skip
        return out

    def _output_now(self) -> FloatArray:
        out = np.empty(len(self.outputs))
        _kernels.head_angles(self._state, self._axes, self._cross, out)
        return out

    def _truth_now(self) -> FloatArray:
        temperature, martensite, effective = self._state[:, :3].T
        age = min(self._age[0] + self._age[1] * self._clock, 1.0)
        stress = self._axes[:, 10] * (temperature - effective - 5.0 * age)
        return np.array([self._output_now(), temperature, stress, martensite, self._state[:, 6]])

    def _peaks(self) -> tuple[FloatArray, FloatArray]:
        """Return the highest temperature and stress of each wire so far. For scoring only."""
        return self._state[:, 4].copy(), self._state[:, 5].copy()

    def _identity(self) -> dict[str, Any]:
        return {
            **super()._identity(),
            "surroundings": repr(self.surroundings),
            "ageing": self.ageing,
            "drift": self.drift,
        }


class Wire(HeatedWires):
    """One wire of 0.2 x 70 mm, its spring and its pulley: current in, angle out.

    Its seventeen parameters are those of the material, the spring and the pulley; options are those
    of ``HeatedWires``.

    Notes
    -----
    Per metre of wire, with temperature T, martensite fraction xi, stress s and current i:

    m c dT/dt = i^2 R(xi) - h P (T - T_amb) + m dH dxi/dt,
    T_e = T - s / C,
    dxi = -xi a tan(a (T_e - A_s) / 2) dT_e on heating between A_s and A_f, a = pi / (A_f - A_s),
    dxi = -(1 - xi) b cot(b (T_e - M_f) / 2) dT_e on cooling between M_s and M_f,
    s = (F + k L (e_0 - e_L xi)) / (A + k L / E(xi)),
    x = L (e_0 - e_L xi - s / E(xi)), angle = x / r.

    The third and fourth are the cosine laws of Liang and Rogers (1990) in differential form,
    which gives smooth minor loops. With a ``Cooling`` in the surroundings, h depends on T and on
    the angle, and T_amb is replaced by a mean of it and of the temperature T_b of the body,

    C dT_b/dt = share (sum over wires of h P L (T - T_b)) - G (T_b - T_amb).

    The heat is integrated by implicit Euler, the kinetics exactly, and every step solves for the
    stress. The constants of the material are those of
    Brinson (1993) and of a data sheet; those of the mechanism are chosen to give the 60 degrees
    at 400 mA of Boudjabi, Ferreira and Krupa (2003).
    """

    kind = "wire"
    inputs = (Channel("current", "A", 0.0, HIGHEST_CURRENT),)
    outputs = (Channel("angle", "deg"),)
    _nominal = WIRE
    _rest_input = (0.0,)

    def _wires(self) -> list[dict[str, float]]:
        return [self._parameters]

    def _coupling(self) -> FloatArray:
        return np.zeros(5)


def wire_numbers(wire: dict[str, float], offset: float = 0.0) -> FloatArray:
    """Return the parameters of a wire per metre, (19,) for the compiled loops.

    ``wire``: the parameters by the names of ``WIRE``. ``offset``: force on the cold wire besides
    the preload, in N; the length is trimmed so that the angle is then 0.
    """
    area = 0.25 * math.pi * DIAMETER**2
    mass = wire["density"] * area
    rest = (wire["preload"] + offset) / area / wire["modulus_martensite"]
    names = tuple(wire)
    return np.array(
        [
            mass * wire["heat_capacity"],
            mass * wire["latent_heat"],
            wire["resistivity_martensite"] / area,
            wire["resistivity_austenite"] / area,
            math.pi * DIAMETER,
            wire["length"],
            area,
            *(wire[name] for name in names[names.index("recoverable_strain") :]),
            rest,
        ]
    )
