"""What the head adds to the addresses, models and instruments of minorloop."""

import numpy as np
import pytest

from minorloop import Actuator, ModelFileError, ParameterError, Preisach, connect, load, save
from minorloop.lab.noise import RepeatedReadings
from minorloop.lab.run import Restorable
from minorloop.lab.wrapped_actuator import single_channel
from minorloop.modelfile import read
from minorloop_head.heated_wire import HeatedWire
from minorloop_head.twins.head import Head
from minorloop_head.twins.sensor import SimulatedFault
from minorloop_head.twins.surroundings import Surroundings, convection


@pytest.mark.parametrize("name", ["wire", "head", "catheter"])
def test_every_twin_has_an_address_and_names_its_options(name):
    assert isinstance(connect(f"twin:{name}"), Actuator)
    with pytest.raises(ParameterError, match=f"twin:{name} has no option 'wind'; it takes.* tick"):
        connect(f"twin:{name}", wind=3.0)


def test_the_simulated_pipe_is_named_with_what_opens_it():
    with pytest.raises(ParameterError, match="'twin:pipe'"):
        connect("twin:pip")
    with pytest.raises(ParameterError, match=r"^twin:pipe is opened only by minorloop head ident"):
        connect("twin:pipe")


def test_options_disturb_a_twin():
    still = connect("twin:wire").apply(0.35, 40.0, 40.0).y[-1]
    windy = connect("twin:wire", surroundings=Surroundings(convection=convection("flooded")))
    assert windy.apply(0.35, 40.0, 40.0).y[-1] < 0.1 * still
    lost = connect("twin:head", faults=[SimulatedFault("tilt", "lost", 0.0)], delay=0.04)
    assert np.isnan(lost.exchange([0.1, 0.1])[1])
    assert connect("twin:wire", ageing=1.0).apply(0.4, 80.0, 80.0).y[-1] < 56.0
    with pytest.raises(ParameterError, match="delay is -1"):
        connect("twin:wire", delay=-1.0)


def test_an_input_of_a_head_stays_restorable():
    tilt = single_channel(Head(), "tilt current [A]")
    assert isinstance(tilt, Restorable)
    state = tilt.checkpoint()
    first = tilt.apply(0.3, 1.0, 0.5).y
    tilt.restore(state)
    np.testing.assert_array_equal(tilt.apply(0.3, 1.0, 0.5).y, first)


def test_a_wire_below_its_threshold_is_suspect_and_not_faulty():
    levels = 0.3 * np.concatenate([np.linspace(0, 1, 11), np.linspace(0.9, 0, 10)])
    wire, repeated, said = connect("twin:wire", specimen=1000), RepeatedReadings.of_plan(levels), []
    held = [wire.apply(float(level), 60.0, 6.0).y for level in levels]
    digit = 1e-3 * np.ptp(np.concatenate(held))
    for level, y in zip(levels, held, strict=True):
        repeated = repeated.after(level, np.round(y / digit) * digit)
        said.append(repeated.verdict)
    assert "suspect" in said
    assert "faulty" not in said


def test_a_heated_wire_is_kept_in_a_model_file(tmp_path):
    model = HeatedWire(Preisach([-1.0, 0.0, 2.0], [[0.1, 0.0], [1 / 3, 5e-324]]), 1 / 3, 0.1)
    save(model, tmp_path / "model.json")
    again = load(tmp_path / "model.json")
    assert (again.lag, again.latent) == (model.lag, model.latent)
    np.testing.assert_array_equal(again.operator.weights, model.operator.weights)
    with pytest.raises(ModelFileError, match="kind 'heated-wire'"):
        _ = read(tmp_path / "model.json").operator
