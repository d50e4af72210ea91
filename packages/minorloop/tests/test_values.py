import pytest

from minorloop.errors import ParameterError
from minorloop.values import as_duration, called, merged, numbers, parsed


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("laser:30,15,0,0.1", ("laser", "30,15,0,0.1", {})),
        ("table:a.csv,name=x,unit=1/m", ("table", "a.csv", {"name": "x", "unit": "1/m"})),
        ("sines:amplitudes=0.7,1,tick=2", ("sines", "", {"amplitudes": "0.7,1", "tick": "2"})),
        ("adaptive", ("adaptive", "", {})),
        ("adaptive,holds=12", ("adaptive", "", {"holds": "12"})),
        ("curves=a:b, c,least-gain=3", ("", "", {"curves": "a:b, c", "least_gain": "3"})),
        ("module:made.rig:COM3", ("module", "made.rig:COM3", {})),
        ("", ("", "", {})),
    ],
)
def test_a_text_has_a_kind_and_values_by_key(text, parts):
    found = parsed(text)
    assert (found.kind, found.what, dict(found.options)) == parts


def test_the_last_of_several_texts_counts():
    found = merged(["levels=8,lag=0", "dynamics:levels=4"], "plane")
    assert (found.kind, dict(found.options)) == ("dynamics", {"levels": "4", "lag": "0"})
    assert merged([], "plane").kind == "plane"


def made(levels: int | str, name: str | None = None, slope: bool | str = "auto"):
    return levels, name, slope


def test_values_are_what_their_parameters_take():
    assert called(made, "it", {"levels": "8", "name": "8", "slope": "no"}) == (8, "8", False)
    assert called(made, "it", {"slope": "0.5"}, levels="auto") == ("auto", None, 0.5)
    with pytest.raises(ParameterError, match="it has no 'level'; it has name, slope"):
        called(made, "it", {"level": "8"}, levels=3)
    with pytest.raises(ParameterError, match="a key twice"):
        parsed("a=1,a=2")


@pytest.mark.parametrize("text", ["", "1,x", "1,2,3"])
def test_numbers_are_counted(text):
    assert numbers("1e-3,-2", (2,), "it", "A,B") == [1e-3, -2.0]
    with pytest.raises(ParameterError, match="give A,B, numbers separated by commas"):
        numbers(text, (2,), "it", "A,B")


def test_durations_have_the_unit_that_suits():
    assert [as_duration(seconds) for seconds in (2.5, 1200, 7200)] == ["2.5 s", "20 min", "2 h"]
