import json
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from minorloop.errors import ParameterError
from minorloop.lab.conversion import (
    CalibrationPolynomial,
    CalibrationTable,
    LaserCurvature,
    as_json,
    from_json,
    from_text,
    linear,
)
from minorloop.lab.curvature import displacement_from_curvature
from minorloop.lab.records import Quantity

READING = Quantity("distance", "mm")


class TestLaser:
    @given(
        kappa=st.floats(-30, 30),
        unit=st.sampled_from([("mm", 1e3), ("um", 1e6), ("m", 1.0), ("cm", 100.0)]),
    )
    def test_it_returns_the_curvature_that_bent_the_strip(self, kappa, unit):
        name, per_metre = unit
        laser = LaserCurvature(0.02 * per_metre, 0.015 * per_metre, unit=name)
        d = displacement_from_curvature(kappa, 0.02, 0.015) * per_metre
        assert laser.convert([d])[0] == pytest.approx(kappa, abs=1e-9)
        assert laser.quantity(READING) == Quantity("curvature", "1/m")

    def test_its_uncertainty_is_that_of_displaced_geometry(self):
        laser = LaserCurvature(20.0, 15.0, 0.02, 0.05)
        chance = np.random.default_rng(1000)
        d = 18.5
        found = [
            LaserCurvature(
                *(np.array([20.0, 15.0]) + chance.normal(size=2) * [0.02, 0.05])
            ).convert(d)
            for _ in range(2000)
        ]
        assert np.std(found) == pytest.approx(laser.sd(d), rel=0.06)

    def test_beyond_a_quarter_circle_there_is_no_curvature(self):
        laser = LaserCurvature(20.0, 15.0)
        found = laser.convert([4.9, 5.1, 20.0, 34.9, 35.1, np.nan])
        assert np.isfinite(found).tolist() == [False, True, True, True, False, False]
        assert laser.covered == "5 to 35 mm, a quarter circle to either side"


class TestCalibrations:
    def test_linear_and_polynomial(self):
        np.testing.assert_allclose(linear(2.0, 1.0).convert([0.0, 3.0]), [1.0, 7.0])
        cubic = CalibrationPolynomial("force", "N", 0.1, (1.0, 0.0, 0.0, 2.0))
        np.testing.assert_allclose(cubic.convert([2.0, np.nan]), [17.0, np.nan])
        assert cubic.quantity(READING) == Quantity("force", "N")
        assert linear(2.0).quantity(READING) == READING
        assert cubic.sd([1.0, 2.0]).tolist() == [0.1, 0.1]

    def test_a_table_is_straight_between_its_points_and_ends_with_them(self):
        for order in (slice(None), slice(None, None, -1)):
            table = CalibrationTable(
                "um", "um", 0.0, [0.0, 1.0, 3.0][order], [5.0, 7.0, 6.0][order]
            )
            found = table.convert([0.5, 2.0, 3.0, 3.1])
            np.testing.assert_allclose(found, [6.0, 6.5, 6.0, np.nan])
            assert table.covered == "the table, 0 to 3"

    def test_a_table_is_read_from_a_file(self, tmp_path):
        file = tmp_path / "table.csv"
        file.write_text("reading [V],force [N]\n0,0\n1,10\n")
        table = CalibrationTable.from_csv(file)
        assert table.quantity(READING) == Quantity("force", "N")
        assert table.convert(0.25) == 2.5
        file.write_text("a,b,c\n0,0,0\n")
        with pytest.raises(ParameterError, match="has 3 columns; a calibration table has two"):
            CalibrationTable.from_csv(file)


@pytest.mark.parametrize(
    "conversion",
    [
        CalibrationPolynomial(coefficients=(0.0, 5.0, -11.5, 2.0, 3.0)),
        CalibrationPolynomial(coefficients=(0.0, 1.0)),
        CalibrationTable(readings=(2.0, 1.0, -2.0), values=(1.0, 4.0, 3.0)),
        LaserCurvature(0.0, 5.0),
    ],
)
def test_a_conversion_only_rises_or_falls_between_its_turns(conversion):
    turns = conversion.turns[np.abs(conversion.turns) < 2.0]
    for low, high in pairwise([-2.0, *turns, 2.0]):
        steps = np.diff(conversion.convert(np.linspace(low, high, 30)))
        assert (steps >= 0).all() or (steps <= 0).all()


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("laser:20,15,0.02,0.05", LaserCurvature(20.0, 15.0, 0.02, 0.05)),
        ("linear:-1,20,name=x,unit=um", CalibrationPolynomial("x", "um", 0.0, (20.0, -1.0))),
        ("polynomial:20,-1,calibration_sd=2", CalibrationPolynomial(None, None, 2.0, (20.0, -1.0))),
        ("table:table.csv,unit=1", CalibrationTable("force", "1", 0.0, (18, 22), (2, -2))),
    ],
)
def test_a_conversion_is_read_from_a_text_and_kept_as_json(text, same, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "table.csv").write_text("distance [mm],force [N]\n18,2\n22,-2\n")
    found = from_text(text, READING)
    (tmp_path / "table.csv").unlink()
    again = from_json(json.loads(json.dumps(as_json(found))))
    x = [18.0, 19.5, 22.0]
    for one in (found, again):
        np.testing.assert_array_equal(one.convert(x), same.convert(x))
        np.testing.assert_array_equal(one.sd(x), same.sd(x))
        assert one.quantity(READING) == same.quantity(READING)
    with pytest.raises(ParameterError, match="is not a conversion"):
        from_json({"laser": "20,15"})
