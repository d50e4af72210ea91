"""The differentiable function against finite differences, the design matrix, and by learning."""

import sys
from importlib import import_module
from importlib.util import find_spec

import numpy as np
import pytest

from minorloop import MissingExtraError, ParameterError, PrandtlIshlinskii, Preisach
from minorloop.identification.design_matrix import DesignMatrix, PlaneSpec, pack

if find_spec("jax") is None:
    pytest.skip("jax is not installed; pip install 'minorloop[jax]'", allow_module_level=True)


@pytest.fixture(autouse=True)
def _wide():
    """Import jax here: that takes a second, and all workers import this file."""
    global jax, jnp, as_function, as_model
    import jax
    from jax import numpy as jnp

    from minorloop.export.jax import as_function, as_model

    with jax.enable_x64(True):
        yield


def preisach(seed=0, bands=5, **options):
    rng = np.random.default_rng(seed)
    levels = np.cumsum(rng.uniform(0.2, 0.5, bands + 1)) - 1.0
    weights = np.tril(rng.normal(size=(bands, bands)))
    return Preisach(levels, weights, offset=0.3, slope=rng.normal(), **options)


def plays(seed=0):
    rng = np.random.default_rng(seed)
    return PrandtlIshlinskii([0.0, 0.2, 0.5, 0.9], rng.normal(size=4), 0.7)


def inputs(model, seed, size=40):
    """Inputs on and off the grid; no two equal, so that there is a gradient."""
    low, high = (-1.2, 1.2) if isinstance(model, PrandtlIshlinskii) else model.levels[[0, -1]]
    return np.random.default_rng(seed).uniform(low - 0.2, high + 0.2, size)


CASES = [
    (preisach(), "negative"),
    (preisach(relay="unipolar", diagonal="reversible"), "demagnetised"),
    (plays(), "positive"),
]


@pytest.mark.parametrize(("model", "start"), CASES)
def test_the_function_equals_the_model(model, start):
    function, parameters = as_function(model, start)
    u = inputs(model, 1)
    np.testing.assert_array_equal(jax.jit(function)(parameters, u), model.simulate(u, start))
    assert as_model(model, parameters) == model


@pytest.mark.parametrize(
    ("start", "relay", "diagonal"),
    [("positive", "bipolar", "uniform"), ("demagnetised", "unipolar", "reversible")],
)
def test_the_gradient_in_the_weights_is_the_design_matrix(start, relay, diagonal):
    model = preisach(3, relay=relay, diagonal=diagonal)
    u, r = inputs(model, 4), np.random.default_rng(5).normal(size=40)
    function, parameters = as_function(model, start)
    _, pull = jax.vjp(lambda p: function(p, u), parameters)
    found = pull(jnp.asarray(r))[0]
    spec = PlaneSpec(model.levels, relay, diagonal, offset=True, slope=True)
    wanted = DesignMatrix(spec, u, np.ones(u.size, dtype=bool), start).dense().T @ r
    np.testing.assert_allclose(pack(np.asarray(found["weights"])), wanted[:-2], atol=1e-12)
    np.testing.assert_allclose([found["offset"], found["slope"]], wanted[-2:], atol=1e-12)
    assert not np.triu(found["weights"], 1).any()


@pytest.mark.parametrize(("model", "start"), CASES)
def test_gradients_in_the_input_equal_finite_differences(model, start):
    step, size = 1e-7, 40
    u, r = inputs(model, 0, size), np.random.default_rng(0).normal(size=size)
    function, parameters = as_function(model, start)
    found = jax.grad(lambda u: r @ function(parameters, u))(jnp.asarray(u))
    ahead, behind = (model.simulate(u + sign * step * np.eye(size), start) @ r for sign in (1, -1))
    np.testing.assert_allclose(found, (ahead - behind) / (2 * step), atol=1e-5)


def test_vmap_equals_a_loop():
    model = preisach()
    function, parameters = as_function(model)
    u = np.stack([inputs(model, seed) for seed in range(3)])
    many = jax.jit(jax.vmap(function, in_axes=(None, 0)))
    np.testing.assert_array_equal(many(parameters, u), model.simulate(u))

    def score(p, u):
        return (function(p, u) ** 2).sum()

    each = [jax.grad(score)(parameters, row) for row in u]
    apart = jax.vmap(jax.grad(score), in_axes=(None, 0))(parameters, u)
    for name in parameters:
        np.testing.assert_allclose(apart[name], np.stack([one[name] for one in each]), rtol=1e-12)


def test_arguments_that_are_not_finite_give_nan():
    model = preisach()
    function, parameters = as_function(model)
    u = inputs(model, 0)
    u[7] = np.nan
    assert np.isnan(function(parameters, u)).all()
    assert np.isnan(jax.grad(lambda u: function(parameters, u).sum())(u)).all()


def test_wrong_shapes_are_refused():
    function, parameters = as_function(preisach())
    for wrong, u, said in (
        ({"weights": parameters["weights"]}, np.zeros(3), "give weights, offset, slope"),
        (parameters, np.zeros(0), "u is empty"),
        ({**parameters, "weights": np.zeros((2, 2))}, np.zeros(3), r"weights has shape \(2, 2\)"),
        (parameters, np.zeros((2, 3)), "jax.vmap for several"),
        (parameters, np.zeros(3, dtype=complex), "complex"),
    ):
        with pytest.raises(ParameterError, match=said):
            function(wrong, u)
    with pytest.raises(ParameterError, match="a list cannot be exported"):
        as_function([])


def test_without_jax_the_message_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "jax", None)
    monkeypatch.delitem(sys.modules, "minorloop.export.jax")
    with pytest.raises(MissingExtraError, match=r"pip install 'minorloop\[jax\]'"):
        import_module("minorloop.export.jax")
