import json
import math
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from minorloop.errors import MinorloopError, ModelFileError, OutputError
from minorloop_head.control.head import LEAD
from minorloop_head.control.limits import WireLimits
from minorloop_head.geometry import Pinhole
from minorloop_head.procedures.calibration import HeadCalibration
from minorloop_head.procedures.head_file import (
    CheckedAxis,
    HeadFile,
    IdentifiedWires,
    read_head,
    save_head,
)
from minorloop_head.vision.measured import Measured
from wires import made_up

LATE, EARLY = datetime(2026, 2, 1, 12, tzinfo=UTC), datetime(2026, 1, 1, tzinfo=UTC)
WIRES = IdentifiedWires(
    on=LATE,
    wires=(made_up(3), made_up(4)),
    coupling=np.array([[1.0, 0.07], [0.06, 1.0]]),
    limits=WireLimits(hottest=120.0),
    highest=0.35,
    check=(CheckedAxis(0.1, 0.2), CheckedAxis(0.3, 0.4)),
    address="twin:head",
    stores={"pan-loop.sqlite": "0" * 64},
)
VIEW = HeadCalibration(
    lens=Pinhole(64, 48, 50.0, (31.5, 23.5)), leds=1e-3 * np.eye(3), radius=9e-3, offset=(1e-4, 0.0)
)
FOUND = (Measured("focal length", 50.0, 0.1, "px"), Measured("lever", 8.0, 0.02, "mm"))
HEAD = HeadFile(serial="H-07", identified=WIRES, calibration=VIEW, calibrated=EARLY, measured=FOUND)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "head.json"


@pytest.fixture
def content(path):
    """A valid file as an object, to be spoilt."""
    save_head(HEAD, path)
    return json.loads(path.read_text())


def test_a_head_is_read_as_it_was_written(path):
    save_head(HEAD, path)
    again = read_head(path)
    assert (again.serial, again.calibrated) == (HEAD.serial, EARLY)
    assert again.calibration.to_dict() == VIEW.to_dict()
    assert again.measured == FOUND
    at_rest = again.calibration.camera_at((0.0, 0.0)), again.calibration.probe_at((0.0, 0.0))
    assert [each.radius for each in at_rest] == [VIEW.radius] * 2
    known = again.identified
    assert (known.on, known.limits, known.highest) == (LATE, WIRES.limits, 0.35)
    assert (known.check, known.stores, known.address) == (WIRES.check, WIRES.stores, "twin:head")
    np.testing.assert_array_equal(known.coupling, WIRES.coupling)
    for one, other in zip(known.wires, WIRES.wires, strict=True):
        np.testing.assert_array_equal(one.operator.weights, other.operator.weights)
        assert (one.lag, one.latent) == (other.lag, other.latent)


def test_a_full_lens_is_kept_and_old_files_without_one_are_read(path, content):
    lens = replace(VIEW.lens, k3=0.1, p1=1e-3, p2=-2e-3, aspect=1.09)
    save_head(replace(HEAD, calibration=replace(VIEW, lens=lens)), path, force=True)
    assert read_head(path).calibration.lens == lens
    for name in ("k3", "p1", "p2", "aspect"):
        del content["calibrated"]["calibration"]["lens"][name]
    path.write_text(json.dumps(content))
    assert read_head(path).calibration.lens == VIEW.lens


def test_the_control_has_the_wires_limits_and_coupling_of_the_file(path):
    save_head(HEAD, path)
    control = read_head(path).control(interval=0.05)
    assert [axis.observer.wire.operator.bands for axis in control.axes] == [3, 4]
    assert control.axes[0].limits.hottest == 120.0
    assert (control.axes[0].observer.highest, control.axes[1].observer.interval) == (0.35, 0.05)
    np.testing.assert_array_equal(control.coupling, WIRES.coupling)
    assert math.isinf(control.lead)
    assert read_head(path).control(by_camera=True).lead == LEAD


def test_a_file_is_not_replaced_unasked(path):
    save_head(HEAD, path)
    with pytest.raises(OutputError, match="exists"):
        save_head(HEAD, path)


def test_a_head_that_was_only_calibrated_cannot_be_controlled(path):
    save_head(HeadFile(serial="H-07", calibration=VIEW, calibrated=LATE), path)
    with pytest.raises(ModelFileError, match="not identified; identify them with minorloop head"):
        read_head(path).control()


@pytest.mark.parametrize(
    ("keys", "value", "message"),
    [
        (["format"], "minorloop model", "no format"),
        (["version"], 2, "install a newer one"),
        (["serial"], 7, "serial"),
        (["serial"], "a\nb", "serial number"),
        (["identified", "wires", 0, "lag"], 0.0, "lag is 0"),
        (["identified", "limits", "hottest"], 900.0, "hottest is 900"),
        (["calibrated", "calibration", "lens", "focal"], -1.0, r"focal lengths \(-1"),
        (["calibrated", "calibration", "leds"], "x", "leds"),
        (["calibrated", "calibration", "leds"], [[1.0, 2.0]], "leds have shape"),
        (["calibrated", "calibration", "radius"], 0.0, "radius is 0"),
        (["identified", "highest"], 4.0, "head.json is not a valid .*: highest is 4.0 A; give"),
        (["identified", "coupling"], [[1.0, 0.9], [0.0, 1.0]], "valid .*: the coupling has rows"),
        (["identified", "wires", 1, "lag"], 1e-9, "the lag of tilt is 1e-09 s; give"),
        (["identified", "on"], "2999-01-01T00:00:00Z", "2999-01-01 00:00 UTC, which"),
        (["calibrated", "calibration", "lever"], math.nan, "'lever' has the value"),
        (["calibrated", "calibration", "x"], 1, "unknown key 'x'"),
    ],
)
def test_a_spoilt_file_is_refused_in_one_sentence(keys, value, message, content, path):
    part = content
    for key in keys[:-1]:
        part = part[key]
    part[keys[-1]] = value
    path.write_text(json.dumps(content))
    with pytest.raises(ModelFileError, match=message) as caught:
        read_head(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_truncated_file_is_refused(path):
    save_head(HEAD, path)
    whole = path.read_bytes().rstrip()
    for length in range(0, len(whole), 97):
        path.write_bytes(whole[:length])
        with pytest.raises(MinorloopError, match="not a valid file of a head"):
            read_head(path)


def test_a_bench_with_lines_for_another_number_of_leds_is_refused():
    HeadFile(serial="H").check_lights(3, "head.json")
    HeadFile(serial="H").check_lights(0, "head.json")
    with pytest.raises(ModelFileError, match="3 LEDs, and the bench has 2 lines for LEDs; give"):
        HeadFile(serial="H").check_lights(2, "head.json")
