"""A polyaniline and carbon nanotube fibre, simulated from its physics.

A voltage dopes the polymer along a steep isotherm. Chains pin their conformation, which causes the
hysteresis. Doping is three times as fast as undoping, diffuses into the fibre, and stretches it.
Then the fibre creeps. The model contains no Preisach operator.
"""

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.lab.actuator import Channel
from minorloop.twins import _kernels
from minorloop.twins.simulated_actuator import SimulatedActuator, prefixed

_NOMINAL = {
    "potential": 0.43,  # V
    "width": 0.11,  # V
    "doping_time": 16.0,  # s
    "undoping_time": 55.0,  # s
    "diffusion_time": 10.0,  # s
    "creep_time": 90.0,  # s
    "creep": 0.05,
    "stretch": 220.0,  # um
    "pinning_1": 0.028,  # V
    "pinning_2": 0.012,
    "release_1": 14.0,
    "release_2": 3.0,
}


class Fibre(SimulatedActuator):
    """A fibre of 15 mm: voltage in, change of length in micrometres out.

    Parameters
    ----------
    specimen, noise, seed, tick, drift, substeps
        As in `SimulatedActuator`, with its errors. All twelve physical parameters differ between
        specimens: potential, width of the isotherm, times of doping, undoping, diffusion and creep,
        creep, stretch, two pinning potentials and their rates of release. Noise is in um. A tick is
        1 s if not given. Drift acts on the stretch.

    Notes
    -----
    With doping q in (0, 1), diffused doping d, creep c and pinning potentials chi_i under u:

    U = E_0 + (1 / f) ln(q / (1 - q)) + sum chi_i,
    dq/dt = f (u - U) / (4 tau), tau by the sign of u - U,
    dchi_i = g_i (X_i dq - chi_i abs(dq)),
    tau_d dd/dt = q - d,
    tau_c dc/dt = c_c d - c,
    change of length = S (d + c).

    An isotherm of Frumkin's type with the hardening law of Armstrong and Frederick (1966). At
    the start the fibre is nearly undoped, q = d = 0.05. Implicit Euler; after a change of
    input the steps grow by 15 % from 0.05 s to 1 s. The parameters are a choice that settles
    within five minutes and spans 1.5 % of the length, from 0.20 to 0.65 V, the voltages of
    Sohn and colleagues.
    """

    kind = "fibre"
    inputs = (Channel("voltage", "V", 0.2, 0.65),)
    outputs = (Channel("length change", "um"),)
    _nominal = _NOMINAL
    _equations = 8
    _integrate = staticmethod(_kernels.fibre_run)
    _default_tick = 1.0
    _rest = (0.05, 0.05, 0.0, 0.0, 0.0)
    _rest_input = 0.2
    _first_step = 0.05
    _longest_step = 1.0

    def _bounds(self, clock: float) -> tuple[FloatArray, FloatArray]:
        own, pinning = self._parameters, prefixed(self._parameters, "pinning")
        channel, pull = self.inputs[0], pinning.sum()
        reach = np.array([channel.low - pull, channel.high + pull]) - own["potential"]
        least, most = 1 / (1 + np.exp(-reach / own["width"]))
        least, most = min(least, self._rest[0]), max(most, self._rest[0])
        low = np.array([least, least, 0.0, *-pinning])
        return low, np.array([most, most, own["creep"] * most, *pinning])

    def _output_now(self) -> float:
        _, diffused, creep = self._state[:3]
        stretch = self._parameters["stretch"]
        return float(self._gain(self._clock) * stretch * (diffused + creep))
