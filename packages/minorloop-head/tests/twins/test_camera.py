"""The simulated camera, against optics."""

import math
from dataclasses import replace

import numpy as np
import pytest

from minorloop_head.geometry import Mount, wall_point
from minorloop_head.twins.camera import Camera, ImageSensor, led_positions
from minorloop_head.twins.pipe import Bore, Crack, Finish, Pipe
from minorloop_head.twins.turbid_water import TurbidWater

MATT = Finish(specular=1e-6, brush=1e-9, streak=1e-9, stain=1e-9, ambient=1e-9, diffuse=0.6)
CLEAN = ImageSensor(
    read=0.0, electrons=1e9, veil_near=0.0, veil_far=0.0, lens_dirt=0.0, readout=0.0
)
PLACE = (0.3, 20e-3)
BARE = Pipe(length=25.6e-3, finish=MATT)
HOLED = replace(BARE, bores=(Bore(*PLACE, 1.1e-3, lining=0.01),))
MOUNT = Mount()
AIM = MOUNT.aim(wall_point(*PLACE, 10e-3))


def looking_at(pipe, *, lights=(True, True, True), gain=1.0, focus=None, **options):
    """A camera that looks at PLACE in focus."""
    camera = Camera(pipe, MOUNT, **options)
    camera.look(*AIM)
    camera.switch(lights)
    camera.expose(0.01, gain)
    depth = MOUNT.pose(*AIM).to_camera(wall_point(*PLACE, 10e-3))[2]
    camera.focus_at(float(depth if focus is None else focus))
    for _ in range(25):
        camera._advance(camera.sensor.interval)
    return camera


def middle(image, half=3):
    v, u = image.shape[0] // 2, image.shape[1] // 2
    return float(image[v - half : v + half, u - half : u + half].mean())


@pytest.mark.parametrize("led", range(3))
def test_a_matt_wall_shines_as_cosine_over_square_of_distance(led):
    lights = tuple(n == led for n in range(3))
    camera = looking_at(BARE, lights=lights, sensor=CLEAN, gain=0.5)
    point = wall_point(*PLACE, 10e-3)
    to_led = MOUNT.pose(*AIM).to_pipe(led_positions()[led]) - point
    far = np.linalg.norm(to_led)
    cosine = -(to_led @ [math.cos(PLACE[0]), math.sin(PLACE[0]), 0.0]) / far
    expected = 100 * 0.5 * 0.6 * cosine * 1e-4 / far**2
    assert middle(camera.frame().image) == pytest.approx(expected, rel=0.03, abs=0.5)


def test_a_hole_is_where_the_score_expects_it():
    camera = looking_at(HOLED, sensor=CLEAN)
    camera.look(AIM[0] + 0.1, AIM[1] - 0.05)
    u, v = camera._pixel(*PLACE)
    image = camera.frame().image.astype(float)
    dark = np.zeros_like(image)
    box = np.s_[int(v) - 25 : int(v) + 26, int(u) - 25 : int(u) + 26]
    dark[box] = image[box] < 0.5 * np.median(image[box])
    rows, columns = np.nonzero(dark)
    assert np.hypot(columns.mean() - u, rows.mean() - v) < 1.0


def test_water_hides_what_is_under_it():
    seen, without = (
        Camera(replace(BARE, water=water), MOUNT, sensor=CLEAN).frame().image.astype(float)
        for water in (2e-3, None)
    )
    below, above = np.s_[400:, 300:340], np.s_[:100, 300:340]
    np.testing.assert_allclose(seen[above], without[above], atol=1.0)
    assert np.abs(seen[below] - without[below]).mean() > 2


def test_light_decays_in_water_and_comes_back_from_it():
    pipe = Pipe(length=25.6e-3, finish=Finish(diffuse=0.6, specular=0.0, streak=0.0, stain=0.0))
    waters = (TurbidWater(0.0, 0.0), TurbidWater(10.0, 0.0), TurbidWater(0.0, 10.0))
    clear, dark, hazy = (
        middle(looking_at(pipe, sensor=CLEAN, flooded=water).frame().image) for water in waters
    )
    far = np.linalg.norm(MOUNT.pose(*AIM).position - wall_point(*PLACE, 10e-3))
    assert dark / clear == pytest.approx(math.exp(-10.0 * 2 * far), rel=0.03)
    assert dark + 0.5 < hazy < clear


def test_a_place_under_water_is_where_the_score_expects_it():
    hole = Pipe(length=51.2e-3, bores=(Bore(*PLACE, 1e-3),))
    camera = looking_at(hole, sensor=CLEAN, flooded=TurbidWater())
    camera.look(AIM[0] + 0.2, AIM[1])
    u, v = np.rint(camera._pixel(*PLACE)).astype(int)
    dry = looking_at(hole, sensor=CLEAN)
    dry.look(AIM[0] + 0.2, AIM[1])
    image = camera.frame().image
    assert np.hypot(*(camera._pixel(*PLACE) - dry._pixel(*PLACE))) > 20
    assert image[v, u] < 0.5 * np.median(image[v - 40 : v + 40, u - 40 : u + 40])


def test_a_crack_that_reaches_out_of_sight_is_seen_under_water():
    phi, z = PLACE
    inside = Crack(((phi, z - 1e-3), (phi, z + 1e-3)), (3e-4, 3e-4), albedo=0.02)
    beyond = Crack((*inside.points, (phi + 1.5, z + 1e-3)), (3e-4,) * 3, albedo=0.02)
    seen = []
    for crack in (inside, beyond):
        camera = looking_at(Pipe(cracks=(crack,)), sensor=CLEAN, flooded=TurbidWater(0.1, 0.1))
        u, v = np.rint(camera._pixel(phi, z)).astype(int)
        seen.append(int(camera.frame().image[v, u]))
    assert seen[0] == pytest.approx(seen[1], abs=2)


def steepness(image):
    """Largest step from column to column across the hole in the middle."""
    return int(np.abs(np.diff(image[image.shape[0] // 2, 280:360].astype(int))).max())


def test_out_of_focus_is_blurred_and_focus_takes_time():
    sharp = looking_at(HOLED, sensor=CLEAN)
    soft = looking_at(HOLED, sensor=CLEAN, focus=5e-3)
    assert steepness(soft.frame().image) < 0.5 * steepness(sharp.frame().image)
    before = soft.focus
    soft.focus_at(20e-3)
    soft.frame()
    assert before < soft.focus < 20e-3
    for _ in range(25):
        soft.frame()
    assert soft.focus == pytest.approx(20e-3)


def test_a_rolling_shutter_sees_rows_one_after_the_other():
    rolling = looking_at(HOLED, sensor=ImageSensor(readout=30e-3))
    rolling.look(*AIM, rates=(0.5, 0.0))
    still = looking_at(HOLED, sensor=CLEAN)
    shift = rolling._pixel(*PLACE)[0] - still._pixel(*PLACE)[0]
    # Half of the readout and of the exposure have passed at the middle row.
    turned = looking_at(HOLED, sensor=CLEAN)
    turned.look(AIM[0] + 0.5 * 0.02, AIM[1])
    expected = turned._pixel(*PLACE)[0] - still._pixel(*PLACE)[0]
    assert shift == pytest.approx(expected, abs=0.5)
