import numpy as np
import pytest

from minorloop.connect import connect
from minorloop.errors import ParameterError
from minorloop.head.twins.sensor import Fault
from minorloop.head.twins.surroundings import Surroundings, convection
from minorloop.lab.actuator import Actuator

TWINS = ("ipmc", "ipmc-laser", "fibre", "wire", "head", "catheter")


@pytest.mark.parametrize("name", TWINS)
def test_every_twin_has_an_address(name):
    twin = connect(f"twin:{name}")
    assert isinstance(twin, Actuator)
    lowest = np.array([channel.low for channel in twin.inputs])
    record = twin.apply(lowest if lowest.size > 1 else lowest[0], 1.0, 0.5)
    assert [str(q) for q in record.inputs] == [str(c) for c in twin.inputs]
    assert [str(q) for q in record.outputs] == [str(c) for c in twin.outputs]


def test_options_reach_the_twin():
    plain = connect("twin:ipmc").exchange(1.0)
    assert connect("twin:ipmc", specimen=1).exchange(1.0) != plain
    noisy = [connect("twin:ipmc", noise=0.1, seed=seed).exchange(1.0) for seed in (1, 1, 2)]
    assert noisy[0] == noisy[1] != noisy[2]


@pytest.mark.parametrize("address", ["twin:impc", "ipmc", "", "twin:", "visa:", "vsa:x"])
def test_refuses_unknown_addresses_and_names_the_known_ones(address):
    with pytest.raises(ParameterError, match=r"give one of .*'twin:ipmc'.*'visa:NAME'"):
        connect(address)


def test_instruments_are_described_by_a_file_and_have_no_specimen(tmp_path):
    with pytest.raises(ParameterError, match="cannot be read"):
        connect(f"visa:{tmp_path / 'bench.json'}")
    with pytest.raises(ParameterError, match="is not simulated; leave specimen"):
        connect("visa:bench.json", specimen=1)
    with pytest.raises(ParameterError, match="has no option 'tick'; it takes clock"):
        connect("visa:bench.json", tick=1.0)


@pytest.mark.parametrize("address", [None, 3, ["twin:wire"]])
def test_refuses_addresses_that_are_not_text(address):
    with pytest.raises(ParameterError, match="there is nothing at address"):
        connect(address)


def test_options_disturb_a_twin():
    still = connect("twin:wire").apply(0.35, 40.0, 40.0).y[-1]
    windy = connect("twin:wire", surroundings=Surroundings(convection=convection("flooded")))
    assert windy.apply(0.35, 40.0, 40.0).y[-1] < 0.1 * still
    lost = connect("twin:head", faults=[Fault("tilt", "lost", 0.0)], delay=0.04)
    assert np.isnan(lost.exchange([0.1, 0.1])[1])
    assert connect("twin:wire", ageing=1.0).apply(0.4, 80.0, 80.0).y[-1] < 56.0
    assert connect("twin:ipmc", tick=0.5).tick == 0.5


@pytest.mark.parametrize("name", TWINS)
def test_refuses_unknown_options_and_names_the_known_ones(name):
    with pytest.raises(ParameterError, match=f"twin:{name} has no option 'wind'; it takes.* tick"):
        connect(f"twin:{name}", wind=3.0)


def test_an_option_out_of_its_range_is_refused():
    with pytest.raises(ParameterError, match="delay is -1"):
        connect("twin:wire", delay=-1.0)
