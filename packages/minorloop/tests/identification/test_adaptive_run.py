import pytest

from minorloop.errors import ParameterError
from minorloop.identification.adaptive import REPEATS, VALIDATION, Adaptive
from minorloop.identification.adaptive_run import design_holds, findings, warnings


def _measured(chooser, reads):
    u, y = [], []
    while (level := chooser.choose(u, y)) is not None:
        u.append(level)
        y.append(reads(len(y), level))
    return u, y


def test_hours_include_validation_and_repetitions_and_holds_do_not():
    assert design_holds(12, None, 200.0) == 12
    assert design_holds(None, 1.0, 200.0) == 18 - VALIDATION - REPEATS
    with pytest.raises(ParameterError, match=r"give 0\.556 h or more"):
        design_holds(None, 0.5, 200.0)


def test_an_outlier_that_was_repeated_is_among_the_findings():
    chooser = Adaptive(-1, 1, levels=10)
    u, y = _measured(chooser, lambda k, u: u + 5.0 * (k == 9))
    found = findings(chooser, u, y)
    assert found.outliers == found.repeated == (9,)
    assert found.changes == ()
    assert "1 outlier: sample 9" in found.warnings[0]
    assert found.holds == 13 - 1
    assert found.validation.trusted


@pytest.mark.parametrize(
    ("reads", "says"),
    [
        (lambda k, u: -u, "the output falls as the input rises"),
        (lambda k, u: u + 3.0 * (k >= 8), "changed at about hold 9"),
        (lambda k, u: u + 9.0 * (k >= 12) * (-1) ** k, "do not trust this model"),
        (lambda k, u: u, ""),
    ],
)
def test_findings_of_a_run_are_reported(reads, says):
    chooser = Adaptive(-1, 1, levels=10)
    u, y = [], []
    while (level := chooser.choose(u, y)) is not None:
        u.append(level)
        y.append(reads(len(y), level))
    said = warnings(chooser, u, y)
    assert says in " ".join(said)
    assert bool(said) == bool(says)
