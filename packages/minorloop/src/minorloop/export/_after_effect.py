"""Template context of an operator with after-effect, stepped at a fixed interval."""

import numpy as np

from minorloop.arrays import FloatArray, as_seconds
from minorloop.errors import NotInvertibleError, ParameterError
from minorloop.export._tables import VECTORS, Numbers, Parts
from minorloop.operators import _after_effect_kernels as _kernels
from minorloop.operators.after_effect import AfterEffect

_LEAST = {True: 2e-7, False: 4e-16}
"""Width of a bracket, over the input, at which a search ends: neighbouring floats and doubles."""
_SETTLED = {True: 1e-5, False: _kernels.SETTLED}
"""Distance from the input that counts as none, as in `_after_effect_kernels`."""


def after_effect_parts(
    model: AfterEffect, numbers: Numbers, inverse: bool, interval: float | None, memory: int
) -> Parts:
    """Return context, inputs of the self-test and bytes of an operator with after-effect.

    Raises a `NotInvertibleError` if ``inverse`` is true and there is none; a `ParameterError` if
    the interval is missing or not positive, or levels coincide in the type of the C.
    """
    if interval is None:
        raise ParameterError(
            "the model changes with time; give the seconds between samples (interval, --interval)"
        )
    seconds = as_seconds("interval", interval)
    if inverse and not model.monotone:
        raise NotInvertibleError(
            "the model is not monotone, so its C cannot have an inverse; export it without "
            "(inverse=False, --no-inverse)"
        )
    tables, base = model.tables, model.plane
    for values in (base.levels, tables.marks):
        if not (np.diff(numbers.array(values)) > 0).all():
            raise ParameterError("levels coincide in a float; export doubles")
    numbers.check_range("input", base.levels)
    numbers.check_range("output", model.range)
    planes, packed = tables.saturation.size, np.tril_indices(base.bands + 1)
    nodes = np.concatenate([tables.nodes[..., k][packed] for k in range(planes)])
    bowed = base.diagonal == "uniform"
    second = tables.bow if bowed else tables.reversible
    gained = np.append(1.0, -np.expm1(-seconds / tables.times))
    thermal = tables.settling > 0
    written = {
        "levels": numbers.table(base.levels),
        "marks": numbers.table(tables.marks),
        "nodes": numbers.table(nodes),
        "bow" if bowed else "reversible": numbers.table(second.T.ravel()),
        "saturation": numbers.table(tables.saturation),
        "gained": numbers.table(gained),
    }
    single = numbers.single
    both = thermal and planes > 1
    if both:
        written["times"] = numbers.table(tables.times)
        written["points"] = numbers.table(_kernels.POINTS)
        written["shares"] = numbers.table(_kernels.SHARES)
    parts = [f"{base.bands} bands, {base.relay} relays, {base.diagonal} diagonal"]
    if thermal:
        parts.append(f"thresholds settle in {model.settling:.3g} s")
    parts += [f"creep of {time:.3g} s" for time in model.times]
    context = {
        "tables": written,
        "bands": base.bands,
        "planes": planes,
        "memory": memory,
        "slope": numbers.one(base.slope),
        "thermal": thermal,
        "lost": numbers.one(-np.expm1(-seconds / model.settling)) if thermal else "",
        "least": numbers.one(_LEAST[single]),
        **{name: name + "f" * single for name in ("exp", "expm1", "log", "log1p")},
        "interval": numbers.one(seconds),
        "settling": numbers.one(model.settling),
        "at_once": numbers.one(_kernels.AT_ONCE),
        "stretch": numbers.one(_kernels.STRETCH),
        "settled": numbers.one(_SETTLED[single]),
        "count": _kernels.POINTS.size,
        "bowed": bowed,
        "seconds": f"{seconds:.6g}",
        "about": f"{'; '.join(parts)}.",
    }
    count = (1 + thermal) * base.levels.size + nodes.size + second.size + 2 * planes
    count += both * (planes - 1 + 2 * _kernels.POINTS.size)
    extremum = (2 + planes) * numbers.size + numbers.size  # the band, padded
    return Parts(
        context,
        table_bytes=count * numbers.size,
        state_bytes=(memory + 1) * extremum + (planes + 3) * numbers.size,
        memory=memory,
        inputs=_inputs(model),
        start="negative",
        template="after_effect",
        title="a Preisach operator with after-effect",
    )


def _inputs(model: AfterEffect) -> FloatArray:
    """Return inputs with loops and holds over the whole plane."""
    low, high = model.plane.levels[[0, -1]]
    shares = np.random.default_rng(0).beta(0.7, 0.7, VECTORS // 2)
    return np.repeat(low + shares * (high - low), 2)
