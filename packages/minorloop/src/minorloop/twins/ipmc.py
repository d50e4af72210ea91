"""An ionic polymer-metal composite strip, simulated from its physics.

A voltage charges the double layers of the strip through a strongly nonlinear capacity. Ion clusters
are pinned to their sites, which causes the hysteresis. The charge bends the strip at once; water
that it drags along flows back and relaxes the bending; the polymer creeps. The model contains no
Preisach operator, and its loops violate congruency and wiping-out slightly.
"""

import numpy as np
import numpy.typing as npt

from minorloop.arrays import FloatArray, as_waveform
from minorloop.lab.actuator import Channel
from minorloop.lab.records import Record
from minorloop.twins import _kernels
from minorloop.twins.simulated_actuator import SimulatedActuator, prefixed

_NOMINAL = {
    "charging_time": 0.35,  # s
    "saturation": 2.5,  # V
    "relaxation_time": 28.0,  # s
    "drag": 0.35,
    "bending": 15.3,  # 1/(V m)
    "asymmetry": 0.48,  # 1/(V^2 m)
    "set": 0.35,  # 1/m
    "creep_time": 60.0,  # s
    "creep": 0.03,
    "pinning_1": 0.10,  # V
    "pinning_2": 0.09,
    "pinning_3": 0.06,
    "release_1": 14.0,  # 1/V
    "release_2": 3.5,
    "release_3": 1.0,
    # The two of sensing are a choice: a few millivolts that fade within seconds.
    "sensing_gain": 0.25,  # mV m
    "sensing_time": 4.0,  # s
}


class Ipmc(SimulatedActuator):
    """A strip of 20 x 5 x 0.1 mm, clamped at one end: voltage in, curvature out.

    Parameters
    ----------
    specimen, noise, seed, tick, drift, substeps
        As in `SimulatedActuator`, with its errors. All seventeen physical parameters differ between
        specimens: times of charging, relaxation, creep and sensing, saturation, drag, bending,
        asymmetry, set, creep, three pinning potentials and their rates of release, and sensing
        gain. Noise is in 1/m; an error of 1 um of a laser 15 mm above the clamp is 0.009 1/m. A
        tick is 0.1 s if not given. Drift acts on the bending per volt.

    Notes
    -----
    With charge q, water w, creep c and pinning potentials chi_i under a voltage u:

    tau_1 dq/dt = u - sum chi_i - v_s atanh(q / v_s),
    dchi_i = g_i (X_i dq - chi_i abs(dq)),
    tau_2 dw/dt = r q - w,
    m = k_0 (q - w) - 2 a_2 (q - w)^2 + m_0,
    tau_c dc/dt = c_c m - c,
    kappa = m + c.

    The second is the kinematic hardening law of Armstrong and Frederick (1966). Implicit
    Euler; after a change of input the steps grow by 15 % from 0.02 s to 3 s. The parameters
    are a choice that reproduces the figures which Chen, Tan and Shahinpoor (2005) give in
    words: 8.2 1/m per volt, a wide loop, back-relaxation, settled after 200 s.
    """

    kind = "ipmc"
    inputs = (Channel("voltage", "V", -1.2, 1.2),)
    outputs = (Channel("curvature", "1/m"),)
    _nominal = _NOMINAL
    _equations = 9
    _integrate = staticmethod(_kernels.ipmc_run)
    _default_tick = 0.1
    _rest = (0.0,) * 6
    _rest_input = 0.0
    _first_step = 0.02
    _longest_step = 3.0

    def sense(self, t: npt.ArrayLike, curvature: npt.ArrayLike) -> Record:
        """Return the voltage of the open strip while it is bent from outside.

        The record has the curvature as input and the voltage in mV as output, without noise.

        Bending squeezes ions towards one face; the charge builds up with the curvature and
        leaks back: tau dv/dt = s tau dkappa/dt - v. The strip is relaxed at the first sample.
        Driving and sensing do not influence each other here, and no simulated time passes.

        Raises a `SignalError` if the shapes differ, a number is not finite, or time does not
        increase.

        ``t`` (T,): strictly increasing times, in seconds; ``curvature`` (T,): imposed curvature in
        1/m, linear between samples.
        """
        times, bending = as_waveform(t, curvature)
        gain, tau = self._parameters["sensing_gain"], self._parameters["sensing_time"]
        v = _kernels.relaxing(np.diff(times), bending, gain, tau)
        return Record(bending, v, times, "curvature [1/m]", "voltage [mV]")

    def _bounds(self, clock: float) -> tuple[FloatArray, FloatArray]:
        own, pinning = self._parameters, prefixed(self._parameters, "pinning")
        full = own["saturation"]
        charge = full * np.tanh((self.inputs[0].high + pinning.sum()) / full)
        water = own["drag"] * charge
        gain = max(1.0, float(self._gain(clock)))
        most = charge + water
        bend = gain * (own["bending"] * most + 2 * own["asymmetry"] * most**2) + own["set"]
        high = np.array([charge, water, own["creep"] * bend, *pinning])
        return -high, high

    def _output_now(self) -> float:
        charge, water, creep = self._state[:3]
        z = charge - water
        bend = self._parameters["bending"] * z - 2 * self._parameters["asymmetry"] * z * z
        return float(self._gain(self._clock) * bend + self._parameters["set"] + creep)
