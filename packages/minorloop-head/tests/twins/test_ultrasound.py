import numpy as np
import pytest

from minorloop_head.geometry import Mount, Probe, wall_point
from minorloop_head.twins import _echo_kernels as kernels
from minorloop_head.twins.pipe import Bore, Pipe
from minorloop_head.twins.sensor import SimulatedFault
from minorloop_head.twins.ultrasound import Ultrasound, compile_echoes

FULL = -9.99e-3
MOUNT = Mount(advance=20e-3)
PIT = Bore(0.0, 20e-3, 1e-3, depth=0.5e-3)
SPEED = 1482.38


def probe_at(pipe=None, *, probe=None, z=20e-3, phi=0.0, **options):
    options = {"noise": 0.0, "grain": 0.0, "roughness": 0.0, **options}
    sonar = Ultrasound(pipe or Pipe(water=FULL), MOUNT, probe, **options)
    sonar.look(*sonar.probe.aim(MOUNT, wall_point(phi, z, 10e-3)))
    return sonar


def received(sonar):
    return sonar.shot().trace[250:]


def peak(trace):
    return np.abs(trace).max()


def test_a_shot_at_a_pit_compiles_nothing_that_was_not_compiled_before():
    compile_echoes()
    loops = kernels.echo_of_wall, kernels.pressure_at
    compiled = [list(loop.signatures) for loop in loops]
    assert all(compiled)
    probe_at(Pipe(water=FULL, bores=(PIT,))).shot()
    assert [loop.signatures for loop in loops] == compiled


@pytest.mark.parametrize("temperature", [10.0, 20.0, 30.0])
def test_a_plain_wall_echoes_after_twice_its_distance(temperature):
    sonar = probe_at(temperature=temperature)
    spectrum = np.fft.rfft(sonar.shot().trace * (np.arange(2048) > 500))
    envelope = np.abs(np.fft.ifft(np.r_[2 * spectrum, np.zeros(2048 - len(spectrum))]))
    speed = 1402.39 + 5.04 * temperature - 0.058 * temperature**2 + 3.3e-4 * temperature**3
    assert np.argmax(envelope) * 10e-9 == pytest.approx(2 * 8e-3 / speed, abs=20e-9)


def test_in_air_there_is_no_echo():
    assert peak(received(probe_at(Pipe(water=None)))) < 1e-3
    peaks = []
    for phi in (-np.pi / 2, np.pi / 2):  # at the top and at the bottom of a pipe that is half full
        roll = Mount(roll=phi, advance=20e-3)
        sonar = Ultrasound(Pipe(water=0.0), roll, noise=0.0)
        sonar.look(*sonar.probe.aim(roll, wall_point(phi, 20e-3, 10e-3)))
        peaks.append(peak(received(sonar)))
    assert peaks[0] < 1e-3
    assert peaks[1] > 0.3


def test_with_a_lens_the_floor_of_a_pit_echoes_as_loud_as_the_wall_and_without_it_does_not():
    pipe = Pipe(bores=(PIT,), water=FULL)
    lens, bare = (
        probe_at(pipe)._floor_level(),
        probe_at(pipe, probe=Probe(focus=np.inf))._floor_level(),
    )
    assert -3 < 20 * np.log10(lens) < -0.5
    assert -17 < 20 * np.log10(bare) < -12


def test_a_floor_is_late_by_twice_its_depth_and_a_hole_has_none():
    def energy_about(trace, time):
        n = int(time / 10e-9) - 250
        return np.sum(trace[n - 8 : n + 9] ** 2)

    late = 2 * 8.5e-3 / SPEED
    pit = energy_about(received(probe_at(Pipe(bores=(PIT,), water=FULL))), late)
    through = Bore(0.0, 20e-3, 1e-3)
    assert energy_about(received(probe_at(Pipe(bores=(through,), water=FULL))), late) < 0.02 * pit


def test_the_steel_rings_behind_the_wall_at_its_own_time():
    thin = received(probe_at(Pipe(water=FULL, thickness=2e-3)))
    n = int((2 * 8e-3 / SPEED + 2 * 2e-3 / 5900) / 10e-9) - 250
    ringing = peak(thin[n - 10 : n + 11]) / peak(thin)
    assert 0.04 < ringing < 0.13


def test_faults_freeze_or_lose_traces():
    faults = (
        SimulatedFault("echo", "lost", 0.001, 0.002),
        SimulatedFault("echo", "stuck", 0.002, 0.003),
    )
    sonar = probe_at(noise=0.1, faults=faults)
    good, lost, stuck, again = (sonar.shot().trace for _ in range(4))
    assert peak(lost) == 0
    assert (stuck == lost).all()
    assert peak(again) > 0
    assert peak(again - good) > 0
