import numpy as np
import pytest

from fixed_options import Plane, identify
from minorloop import Record, SignalError, excitation
from minorloop.identification.reversal_curves import identify_reversal_curves
from plane_records import LEVELS, a_plane


def test_reversal_curves_give_the_plane_without_a_fit():
    plane, u = a_plane(), excitation.reversal_curves(LEVELS)
    y = plane.simulate(u)
    np.testing.assert_allclose(
        identify_reversal_curves(u, y, LEVELS).weights, plane.weights, atol=1e-12
    )
    y[7] = np.nan
    with pytest.raises(SignalError, match="1 reversal values are missing"):
        identify_reversal_curves(u, y, LEVELS)


def reversal_record(folder, name, field, moment, parity):
    path = folder / name
    table = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")
    top, u, y = table[field].max(), [], []
    for curve in np.unique(table["curve"])[parity::2]:
        rows = (table["curve"] == curve) & (table["kind"] == "curve")
        u += [top, *table[field][rows]]
        y += [np.nan, *table[moment][rows]]
    return np.array(u), np.array(y)


@pytest.mark.parametrize(
    ("name", "field", "moment", "limit"),
    [
        ("forc_feco_nanowires.csv", "field_Oe", "moment_emu", 0.011),
        pytest.param("forc_msm33.csv", "field_T", "moment_Am2", 0.011, marks=pytest.mark.whole),
    ],
)
def test_reversal_curves_of_magnets(shared_data, name, field, moment, limit):
    u, y = reversal_record(shared_data, name, field, moment, 0)
    found = identify(Record(u, y, start="positive"), Plane(51, spacing="adaptive"))
    u, y = reversal_record(shared_data, name, field, moment, 1)
    seen = np.isfinite(y)
    error = (found.model.simulate(u, "positive") - y)[seen]
    assert np.sqrt(np.mean(error**2)) <= limit * np.ptp(y[seen])
