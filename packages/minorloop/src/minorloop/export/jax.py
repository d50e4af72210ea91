"""Convert a model to a differentiable function in JAX, for use in a larger learned model.

JAX calls the compiled loops of the operator; gradients are also compiled loops, their exact
transpose, without smoothing. The output is linear in the weights; their gradient is exact. The
gradient in the input is exact where it exists, which is almost everywhere. If inputs repeat, meet a
remembered extremum or lie on a threshold, it is one of the one-sided gradients; beyond the levels
the gradient of the relays is zero.

Arguments and results have the type of the given arrays, float32 unless ``jax_enable_x64`` is set;
inside, everything is float64. Only reverse mode is supported: `jax.grad` and `jax.vjp`, also under
`jax.jit` and `jax.vmap`, but not `jax.jvp`, `jax.jacfwd`, or derivatives of a gradient such as
`jax.hessian`. If an argument is not finite, the whole output is NaN, and so are its gradients.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, TypeAlias

import numpy as np

from minorloop.arrays import FloatArray, frozen
from minorloop.errors import MissingExtraError, ParameterError
from minorloop.export import _gradient_kernels
from minorloop.identification import _kernels as tree_kernels
from minorloop.identification.design_matrix import everett_tree
from minorloop.operators import _kernels, _play_kernels, plane
from minorloop.operators._parallel import in_parallel
from minorloop.operators.memory import Start
from minorloop.operators.prandtl_ishlinskii import PlayStart, PrandtlIshlinskii
from minorloop.operators.preisach import Preisach

try:
    import jax
    from jax import numpy as jnp
    from jax.core import ShapedArray
    from jax.extend.core import Primitive
    from jax.interpreters import batching, mlir
except ImportError:
    raise MissingExtraError("jax", "jax") from None


Parameters: TypeAlias = dict[str, Any]
"""Arrays of JAX by name: the parameters of a model."""


class _Loops(Protocol):
    """Loops on numpy arrays: arguments in the order of ``names``, the input last."""

    names: tuple[str, ...]
    shapes: tuple[tuple[int, ...], ...]

    def forward(self, *arrays: FloatArray) -> FloatArray:
        """The (T,) output."""

    def backward(self, *arrays: FloatArray) -> Sequence[FloatArray]:
        """Gradients in all arguments; the cotangent of the output comes last."""


def as_function(
    model: Preisach | PrandtlIshlinskii, start: Start | PlayStart = "negative"
) -> tuple[Callable[[Parameters, Any], Any], Parameters]:
    """Convert a model to a function of its parameters and its input.

    ``model``: levels or radii, and the initial parameters; ``start``: memory before the first
    sample, a constant.

    Raises a `ParameterError` if the model is of another kind. The function raises it if shapes are
    wrong, or the input is empty.

    Returns
    -------
    function : callable
        ``function(parameters, u)`` returns the (T,) output for a (T,) input; for many signals
        together, use ``jax.vmap(function, in_axes=(None, 0))``. Only for reverse mode; if an
        argument is not finite the whole output is NaN.
    parameters : dict of str to array
        ``weights`` and ``offset`` of the model, and ``slope`` of a Preisach operator. Weights above
        the diagonal are ignored.

    """
    operator = _operator(model, start)
    call = _differentiable(operator)

    def function(parameters: Parameters, u: Any) -> Any:
        arrays = _checked(operator, parameters, u)
        return call(*arrays)

    floating = jnp.result_type(float)
    return function, {
        name: jnp.asarray(getattr(model, name), dtype=floating) for name in operator.names
    }


def as_model(
    model: Preisach | PrandtlIshlinskii, parameters: Mapping[str, Any]
) -> Preisach | PrandtlIshlinskii:
    """Convert parameters back to a model.

    Raises a `ParameterError` if the model is of another kind, or a parameter is not finite.

    ``model``: the model given to `as_function`; ``parameters``: learned parameters.
    """
    _operator(model, "negative")
    known = {name: np.asarray(value, dtype=np.float64) for name, value in parameters.items()}
    offset = float(known["offset"])
    if isinstance(model, PrandtlIshlinskii):
        return PrandtlIshlinskii(model.radii, known["weights"], offset)
    weights, slope = np.tril(known["weights"]), float(known["slope"])
    return Preisach(model.levels, weights, offset, model.relay, model.diagonal, slope)


class _PreisachLoops:
    """Forward loop and transpose of a Preisach operator on given levels."""

    names: tuple[str, ...] = ("weights", "offset", "slope")

    def __init__(self, model: Preisach, start: Start) -> None:
        self.shapes: tuple[tuple[int, ...], ...] = (model.weights.shape, (), ())
        self._spread = model.diagonal == "uniform"
        self._swing, self._shift = model.swing, -plane.off_output(model.relay)
        self._plane = model.tables
        self._past = np.array(model.memory(start).extrema[1:])

    def forward(self, *arrays: FloatArray) -> FloatArray:
        weights, offset, slope, u = arrays
        inputs = np.concatenate([self._past, u])
        y, stack = np.empty(inputs.size), np.empty((inputs.size + 2, 4))
        known = self._with(weights, float(offset), float(slope))
        stack[0] = known.levels[0], known.saturation, 0.0, 0.0
        _kernels.simulate(known, stack, 1, inputs, y)
        return y[self._past.size :]

    def backward(self, *arrays: FloatArray) -> Sequence[FloatArray]:
        weights, _, slope, u, cotangent = arrays
        inputs, spread = np.concatenate([self._past, u]), np.zeros(self._past.size + u.size)
        spread[self._past.size :] = cotangent
        for_weights, parent = self._pull_weights(inputs, spread)
        for_inputs = np.zeros(inputs.size)
        known = self._with(weights, 0.0, 0.0)
        _gradient_kernels.pull_inputs(known, inputs, parent, spread, for_inputs)
        total = cotangent.sum()
        for_weights = np.tril(self._swing * for_weights - self._shift * total)
        for_inputs = for_inputs[self._past.size :] + slope * cotangent
        return for_weights, total, cotangent @ u, for_inputs

    def _pull_weights(self, inputs: FloatArray, spread: FloatArray) -> tuple[FloatArray, Any]:
        """Transpose of the map from cells to switched-on weight; ``spread`` is summed up."""
        tree = everett_tree(self._plane.levels, self._spread, inputs)
        index, coefficient, parent, _ = tree
        bands = self.shapes[0][0]
        sums = np.zeros(bands * (bands + 1) // 2)
        tree_kernels.adjoint(index, coefficient, parent, spread, sums)
        tree_kernels.nodes_to_cells(bands, sums)
        square = np.zeros((bands, bands))
        square[np.tril_indices(bands)] = sums
        return square, parent

    def _with(self, weights: FloatArray, offset: float, slope: float) -> _kernels.PlaneTables:
        nodes = self._swing * plane.nodes_from_weights(np.tril(weights))
        bow = nodes.diagonal(-1).copy() if self._spread else np.zeros(len(weights))
        off = offset - self._shift * float(np.tril(weights).sum())
        return self._plane._replace(
            nodes=frozen(nodes), bow=frozen(bow), saturation=off, slope=slope
        )


class _PlaysLoops:
    """Forward loop and transpose of weighted plays of given radii."""

    names: tuple[str, ...] = ("weights", "offset")

    def __init__(self, model: PrandtlIshlinskii, start: PlayStart) -> None:
        self.shapes: tuple[tuple[int, ...], ...] = (model.weights.shape, ())
        self._radii, self._start = model.radii, model.positions(start)

    def forward(self, *arrays: FloatArray) -> FloatArray:
        weights, offset, u = arrays
        y, slopes = np.empty(u.size), np.cumsum(weights)
        _play_kernels.simulate(u, self._radii, slopes, float(offset), self._start.copy(), y)
        return y

    def backward(self, *arrays: FloatArray) -> Sequence[FloatArray]:
        weights, _, u, cotangent = arrays
        for_weights, for_inputs = np.zeros(weights.size), np.zeros(u.size)
        movers = np.full(weights.size, -1)
        _gradient_kernels.pull_plays(
            u, self._radii, weights, self._start.copy(), cotangent, for_weights, for_inputs, movers
        )
        return for_weights, cotangent.sum(), for_inputs


def _operator(model: Any, start: Any) -> _Loops:
    if isinstance(model, Preisach):
        return _PreisachLoops(model, start)
    if isinstance(model, PrandtlIshlinskii):
        return _PlaysLoops(model, start)
    raise ParameterError(
        f"a {type(model).__name__} cannot be exported to JAX; give a Preisach or a "
        "PrandtlIshlinskii"
    )


def _checked(operator: _Loops, parameters: Parameters, u: Any) -> list[Any]:
    """Arguments as floating arrays of the shapes that the loops require."""
    if set(parameters) != set(operator.names):
        raise ParameterError(
            f"parameters are {', '.join(sorted(parameters)) or 'none'}; give "
            f"{', '.join(operator.names)}, as as_function does"
        )
    arrays = [_floating(parameters[name]) for name in operator.names]
    for name, array, shape in zip(operator.names, arrays, operator.shapes, strict=True):
        if array.shape != shape:
            raise ParameterError(f"{name} has shape {array.shape}; it must be {shape}")
    signal = _floating(u)
    if signal.ndim != 1:
        raise ParameterError(
            f"u has shape {signal.shape}; give (T,) inputs, and jax.vmap for several signals"
        )
    if not signal.size:
        raise ParameterError("u is empty; give at least one sample")
    return [*arrays, signal]


def _floating(value: Any) -> Any:
    array = jnp.asarray(value)
    if jnp.issubdtype(array.dtype, jnp.floating):
        return array
    if jnp.issubdtype(array.dtype, jnp.complexfloating):
        raise ParameterError("an argument is complex; give real numbers")
    return array.astype(jnp.result_type(float))


def _differentiable(operator: _Loops) -> Callable[..., Any]:
    """Primitive of JAX for the operator, with another primitive for its gradient."""
    cores = [len(shape) for shape in operator.shapes] + [1]
    loop = _primitive("hysteresis", operator.forward, cores, lambda *given: given[-1:])
    back = _primitive("hysteresis_gradient", operator.backward, [*cores, 1], lambda *g: g[:-1])

    def plain(*arrays: Any) -> Any:
        wide = jnp.result_type(*arrays)
        return loop.bind(*(array.astype(wide) for array in arrays))[0]

    def forward(*arrays: Any) -> tuple[Any, tuple[Any, ...]]:
        return call(*arrays), arrays

    def backward(arrays: tuple[Any, ...], cotangent: Any) -> Any:
        return tuple(back.bind(*arrays, cotangent))

    call: Any = jax.custom_vjp(plain)
    call.defvjp(forward, backward)
    return lambda *arrays: call(*arrays)


def _primitive(
    name: str, function: Callable[..., Any], cores: Sequence[int], like: Callable[..., Any]
) -> Any:
    """Convert a loop on numpy arrays to a primitive of JAX, with its rules for jit and vmap.

    `jax.pure_callback` is not an alternative: the thread pool that runs the callback also copies
    its arrays, which is a deadlock on one core.

    ``name``: name in JAX; ``function``: returns one or several arrays for arrays without axes of
    `jax.vmap`; ``cores``: number of axes of each argument; axes before them are those of
    `jax.vmap`; ``like``: selects the arguments with the shapes and types of the results.
    """
    primitive = Primitive(name)
    primitive.multiple_results = True

    def abstract(*given: Any) -> list[Any]:
        lead = _lead(given, cores)
        return [
            ShapedArray(lead + one.shape[one.ndim - core :], one.dtype)
            for one, core in zip(like(*given), like(*cores), strict=True)
        ]

    def run(*given: Any) -> tuple[Any, ...]:
        wanted = [(x.shape, x.dtype) for x in abstract(*given)]
        return _each(function, cores, wanted, *given)

    def batched(given: Sequence[Any], axes: Sequence[Any]) -> tuple[Any, list[int]]:
        moved = [
            jnp.expand_dims(x, 0) if axis is None else jnp.moveaxis(x, axis, 0)
            for x, axis in zip(given, axes, strict=True)
        ]
        found = primitive.bind(*moved)
        return found, [0] * len(found)

    def lowered(context: Any, *given: Any) -> Any:
        return mlir.emit_python_callback(
            context, run, None, given, context.avals_in, context.avals_out, has_side_effect=False
        )[0]

    primitive.def_impl(lambda *given: [jnp.asarray(x) for x in run(*given)])
    primitive.def_abstract_eval(abstract)
    batching.primitive_batchers[primitive] = batched
    mlir.register_lowering(primitive, lowered)
    return primitive


def _lead(given: Sequence[Any], cores: Sequence[int]) -> tuple[int, ...]:
    """Leading axes, those of `jax.vmap`."""
    return np.broadcast_shapes(
        *(x.shape[: x.ndim - core] for x, core in zip(given, cores, strict=True))
    )


def _each(
    function: Callable[..., Any], cores: Sequence[int], wanted: Sequence[Any], *given: Any
) -> tuple[Any, ...]:
    """Apply a loop over the leading axes of `jax.vmap`, in parallel."""
    lead = _lead(given, cores)
    rows = []
    for one, core in zip(given, cores, strict=True):
        array = np.asarray(one, dtype=np.float64)
        own = array.shape[array.ndim - core :]
        rows.append(np.broadcast_to(array, lead + own).reshape(-1, *own))
    found = [np.full((len(rows[0]), *shape[len(lead) :]), np.nan) for shape, _ in wanted]

    def fill(row: int) -> None:
        mine = [np.array(array[row]) for array in rows]
        if all(np.isfinite(array).all() for array in mine):
            results = function(*mine)
            for out, result in zip(found, [results] if len(found) == 1 else results, strict=True):
                out[row] = result

    in_parallel(fill, len(rows[0]))
    return tuple(
        out.reshape(shape).astype(kind) for out, (shape, kind) in zip(found, wanted, strict=True)
    )
