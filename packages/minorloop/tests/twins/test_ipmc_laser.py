import numpy as np

from minorloop.lab.conversion import LaserCurvature
from minorloop.twins.ipmc import Ipmc
from minorloop.twins.ipmc_laser import CODE, DISTANCE, HEIGHT, NOISE, IpmcLaser


def curvature(distance):
    return LaserCurvature(DISTANCE, HEIGHT).convert(distance)


def test_the_laser_shows_the_curvature_of_the_same_strip():
    strip, laser = Ipmc().apply(1.0, 200.0, 10.0), IpmcLaser().apply(1.0, 200.0, 10.0)
    assert str(laser.output) == "distance [mm]"
    # 1 mm is 8.9 1/m.
    np.testing.assert_allclose(curvature(laser.y), strip.y, atol=CODE / 2 * 8.9)


def test_the_height_of_a_specimens_laser_is_not_quite_the_nominal_one():
    ratios = []
    for specimen in range(1000, 1040):
        true = Ipmc(specimen).apply(1.0, 50.0, 50.0).y[-1]
        ratios.append(curvature(IpmcLaser(specimen).apply(1.0, 50.0, 50.0).y[-1]) / true)
    # The curvature goes with the square of the height, which is 15 mm to 0.1 mm.
    assert 0.008 < np.std(ratios) < 0.02
    assert abs(np.mean(ratios) - 1) < 0.006


def test_noise_is_of_the_distance_and_readings_are_whole_codes():
    distance = IpmcLaser(noise=NOISE, seed=3).apply(0.0, 400.0, 0.1).y
    np.testing.assert_allclose(distance / CODE, np.round(distance / CODE), atol=1e-9)
    assert 0.9 * NOISE < np.std(np.diff(distance[2000:])) / np.sqrt(2) < 1.1 * NOISE
