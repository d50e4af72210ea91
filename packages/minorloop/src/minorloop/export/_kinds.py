"""Content of each kind of model for the templates of C and the self-test."""

from dataclasses import replace
from typing import Any

import numpy as np

from minorloop.arrays import FloatArray, as_seconds
from minorloop.dynamics.cascade import First
from minorloop.dynamics.linear import Linear
from minorloop.errors import NotInvertibleError, ParameterError
from minorloop.export._selftest import Parts, asked_of, examples, width_of, worst_digit
from minorloop.export._tables import Numbers, wrapped
from minorloop.operators import plane
from minorloop.operators.after_effect import AfterEffect
from minorloop.operators.generalised_prandtl_ishlinskii import GeneralisedPrandtlIshlinskii
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii
from minorloop.operators.preisach import Preisach
from minorloop.operators.relays import RelayModel

_VECTORS = 200
"""Number of inputs of a self-test, in about 10 kB of C."""
_MOST_LEVELS = 32_000
"""Most levels of relays: their numbers fit into 16 bits with sign."""
_MOST_LAG = 100_000
"""Most intervals of dead time, each of which takes a number in a state."""
_LEAST = {True: 2e-7, False: 4e-16}
"""Width of a bracket, over the input, at which a search ends: neighbouring floats and doubles."""
_WITHOUT = "export it without an inverse (inverse=False, export c:inverse=no)"


def parts_of(
    model: Any, numbers: Numbers, inverse: bool, memory: int, interval: float | None
) -> Parts:
    """Return the parts of an operator without a linear part.

    Raises a `NotInvertibleError` if ``inverse`` is true and there is none; a `ParameterError` if
    the type of the C cannot hold the model, there is no C for its class, or the interval is
    missing.
    """
    if isinstance(model, Preisach):
        return preisach_parts(model, numbers, inverse, memory)
    if isinstance(model, AfterEffect):
        return _after_effect_parts(model, numbers, inverse, memory, interval)
    if isinstance(model, RelayModel):
        return _relay_parts(model, numbers, inverse)
    if isinstance(model, PrandtlIshlinskii | GeneralisedPrandtlIshlinskii):
        return _plays_parts(model, numbers, inverse)
    raise ParameterError(
        f"the model is a {type(model).__name__}, and C is written only for Preisach models, relays "
        "and plays; identify a Preisach model from the same record"
    )


def preisach_parts(
    model: Preisach,
    numbers: Numbers,
    inverse: bool,
    memory: int,
    linear: Linear | None = None,
    first: First = "operator",
) -> Parts:
    """Return the parts of a Preisach operator, alone or with a linear part.

    Raises as `parts_of`.
    """
    if inverse and not model.monotone:
        raise NotInvertibleError(
            f"the model is not monotone (least weight {model.weights.min():g}), so its C cannot "
            f"have an inverse; {_WITHOUT}, or identify with signed=False"
        )
    part = None if linear is None else _linear_context(linear, first, numbers)
    numbers.check_range("input", model.levels)
    numbers.check_range("output", model.range)
    tables, of_tables, table_bytes = _plane_tables(model, numbers)
    drop_error = float(model.swing * np.abs(model.weights).sum()) / (memory - 3)
    u, y, digit = examples(model, _VECTORS, numbers, memory, linear, first)
    input_error = max(digit, worst_digit(model, numbers))
    extremum = 20 if numbers.single else 40  # padded as by compilers
    state_bytes = (memory + 1) * extremum + 8 + 4 * numbers.size
    if linear is not None and part is not None:
        tables["transition"] = numbers.table(-linear.denominator[1:])
        tables["readout"] = numbers.table(linear.state_space[2])
        table_bytes += 2 * numbers.size * part["order"]
        state_bytes += numbers.size * (part["order"] + part["lag"] + (part["lag"] > 0))
    context = {
        "tables": tables,
        **of_tables,
        "memory": memory,
        "linear": part,
        "about": about(model, linear, first),
        "single": f"{drop_error:.3g}",
        "input_error": f"{input_error:.2g}",
    }
    invertible = inverse and model.range[0] < model.range[1]
    return Parts(
        template="model",
        title="a Preisach operator with piecewise uniform density",
        context=context,
        table_bytes=table_bytes,
        state_bytes=state_bytes,
        memory=memory,
        u=u,
        y=y,
        width=width_of(model, linear),
        inverse=invertible and linear is None,
        asked=asked_of(model, linear, first, u) if invertible and linear is not None else None,
        digit=digit,
        drop_error=drop_error,
        input_error=input_error,
    )


def _plane_tables(model: Preisach, numbers: Numbers) -> tuple[dict[str, str], dict[str, Any], int]:
    """Return the tables of a plane, further context for the templates, and the tables' bytes."""
    levels = numbers.check_distinct(model.levels)
    begun, per_unit = plane.buckets(levels)
    nodes = model.tables.nodes
    packed = np.tril_indices(len(nodes))
    signed, wide = bool((model.weights < 0).any()), model.bands > 256
    bowed = model.diagonal == "uniform"
    tables = {
        "levels": numbers.table(levels),
        "per_band": numbers.table(1 / np.diff(levels.astype(np.float64))),
        "begun": wrapped(str(int(band)) for band in begun),
        "nodes": numbers.table(nodes[packed]),
        "bow": numbers.table(nodes.diagonal(-1)),
    }
    if signed:
        unsigned = model.swing * plane.nodes_from_weights(np.abs(model.weights))
        tables["nodes_unsigned"] = numbers.table(unsigned[packed])
        tables["bow_unsigned"] = numbers.table(unsigned.diagonal(-1))
    beside = {
        "bands": model.bands,
        "slices": begun.size,
        "narrow": bool((np.diff(begun) <= 1).all()),
        "slice_type": "uint16_t" if wide else "uint8_t",
        "per_unit": numbers.one(per_unit),
        "saturation": numbers.one(model.all_off),
        "slope": numbers.one(model.slope),
        "sloped": model.slope != 0,
        "signed": signed,
        "bowed": bowed,
        "begin": numbers.one(model.all_off + model.slope * float(model.levels[0])),
        "low": numbers.one(model.levels[0]),
        "high": numbers.one(model.levels[-1]),
        "reach_low": numbers.one(model.range[0]),
        "reach_high": numbers.one(model.range[1]),
        "sqrt": "sqrtf" if numbers.single else "sqrt",
    }
    count = levels.size + model.bands + (1 + signed) * (packed[0].size + bowed * model.bands)
    return tables, beside, numbers.size * count + (2 if wide else 1) * begun.size


def about(model: Preisach, linear: Linear | None, first: First) -> str:
    """Return a comment that describes the model."""
    parts = f"{model.bands} bands, {model.relay} relays, {model.diagonal} diagonal"
    if linear is None:
        return f"{parts}."
    order = "after" if first == "operator" else "before"
    return f"{parts}; a linear part of order {linear.order} {order} it."


def _linear_context(linear: Linear, first: First, numbers: Numbers) -> dict[str, Any]:
    """Return the context of a linear part; refuse one that C cannot step."""
    gain, why = linear.dc_gain, ""
    if linear.interval is None:
        why = "is continuous; give the interval between steps of the C"
    elif linear.lag > _MOST_LAG:
        why = (
            f"has a delay of {linear.delay:g} s, for which the C would have to store {linear.lag} "
            f"intervals; give at most {_MOST_LAG}"
        )
    elif not np.isfinite(gain) or gain == 0:
        why = (
            f"has a DC gain of {gain:g} and no settled state to begin from; give a linear part "
            "whose DC gain is finite and not zero"
        )
    elif not linear.stable:
        why = "is unstable; give a stable linear part"
    if linear.interval is None or why:
        raise ParameterError(f"the linear part {why}")
    return {
        "order": linear.order,
        "lag": linear.lag,
        "interval": numbers.one(linear.interval),
        "feedthrough": numbers.one(linear.state_space[3]),
        "gain": numbers.one(gain),
        "rest": numbers.one(1 / linear.at_rest(linear.denominator)),
        "first": first,
    }


def _relay_parts(model: RelayModel, numbers: Numbers, inverse: bool) -> Parts:
    if inverse:
        raise NotInvertibleError(
            "outputs of relays on level pairs change in steps, so their C cannot have an "
            f"inverse; {_WITHOUT}, or identify a Preisach model"
        )
    numbers.check_range("input", model.levels)
    count = int(model.levels.size)
    if count > _MOST_LEVELS:
        raise ParameterError(f"there are {count} levels; give at most {_MOST_LEVELS} for relays")
    levels = numbers.check_distinct(model.levels)
    largest, reach = np.abs(levels).max(), float(np.ptp(levels.astype(np.float64)))
    of, advice = "is {:.2g} % of the range of the levels", "identify against the input minus its"
    numbers.digit(largest, float(np.spacing(largest)) / reach, of, f"{advice} offset")
    swing, off = model.line()
    # Cumulative weights of each column up to each row; columns one after the other.
    columns = np.cumsum(model.weights, axis=0)
    packed = np.concatenate([columns[b:, b] for b in range(count)])
    begins = np.cumsum([0, *range(count, 1, -1)])
    low, reach = float(model.levels[0]), float(np.ptp(model.levels))
    u = np.random.default_rng(0).uniform(low - 0.1 * reach, low + 1.1 * reach, _VECTORS)
    # Outputs jump at the rounded thresholds of the C.
    rounded = replace(model, levels=levels.astype(np.float64))
    return Parts(
        template="relays",
        title="weighted relays on level pairs",
        context={
            "levels": count,
            "cells": packed.size,
            "off": numbers.one(off),
            "swing": numbers.one(swing),
            "low": numbers.one(model.levels[0]),
            "high": numbers.one(model.levels[-1]),
            "tables": {
                "levels": numbers.table(levels),
                "columns": numbers.table(packed),
                "begins": wrapped(str(int(begin)) for begin in begins),
            },
        },
        table_bytes=numbers.size * (count + packed.size) + 4 * count,
        state_bytes=-(-(2 * count + 2) // numbers.size) * numbers.size + numbers.size,
        memory=count,
        inverse=False,
        **_simulated(rounded, numbers, u, "negative"),
    )


def _plays_parts(
    model: PrandtlIshlinskii | GeneralisedPrandtlIshlinskii, numbers: Numbers, inverse: bool
) -> Parts:
    if inverse and not model.invertible:
        raise NotInvertibleError(
            "the plays have no linear term, or a cumulative sum of their weights or a slope of "
            f"their dead zones is not positive, so their C cannot have an inverse; {_WITHOUT}"
        )
    bent = isinstance(model, GeneralisedPrandtlIshlinskii)
    plays = model.plays if isinstance(model, GeneralisedPrandtlIshlinskii) else model
    count = plays.radii.size
    tables = {"radii": numbers.table(plays.radii), "slopes": numbers.table(plays.slopes)}
    context = {"plays": count, "offset": numbers.one(plays.offset), "bent": bent, "tables": tables}
    numbers_kept = 2 * count
    if isinstance(model, GeneralisedPrandtlIshlinskii):
        # Corners, also the origin, and the slopes of the pieces between and beyond them.
        zones = model.zones
        centre = int(np.count_nonzero(zones.knots < 0))
        corners, heights = (np.insert(x, centre, 0.0) for x in (zones.knots, zones.heights))
        gains = np.insert(zones.slopes, centre, zones.slopes[centre])
        kept = {"corners": corners, "heights": heights, "gains": gains}
        tables |= {name: numbers.table(values) for name, values in kept.items()}
        shift = numbers.one(model.offset)
        context |= {"corners": corners.size, "origin": centre, "shift": shift}
        numbers_kept += 3 * corners.size + 1
    reach = 2 * float(plays.radii[-1]) or 1.0
    u = np.random.default_rng(0).uniform(-reach, reach, _VECTORS)
    return Parts(
        template="plays",
        title=f"{'bent' if bent else 'weighted'} plays, a Prandtl-Ishlinskii operator",
        context=context,
        table_bytes=numbers_kept * numbers.size,
        state_bytes=(count + 1) * numbers.size,
        memory=count,
        inverse=inverse,
        **_simulated(model, numbers, u, "demagnetised"),
    )


def _simulated(model: Any, numbers: Numbers, u: FloatArray, start: str) -> dict[str, Any]:
    """Return rounded inputs, outputs and their range, within the range of the type."""
    u = numbers.array(u).astype(np.float64)
    y = model.simulate(u, start)
    numbers.check_range("input", u)
    numbers.check_range("output", y)
    return {"u": u, "y": y, "width": float(np.ptp(y))}


def _after_effect_parts(
    model: AfterEffect, numbers: Numbers, inverse: bool, memory: int, interval: float | None
) -> Parts:
    if interval is None:
        raise ParameterError(
            "the model changes with time; give the seconds between samples (interval, --interval)"
        )
    seconds = as_seconds("interval", interval)
    if inverse and not model.monotone:
        raise NotInvertibleError(
            f"the model is not monotone, so its C cannot have an inverse; {_WITHOUT}"
        )
    tables, base, single = model.tables, model.plane, numbers.single
    for values in (base.levels, tables.marks):
        numbers.check_distinct(values)
    numbers.check_range("input", base.levels)
    numbers.check_range("output", model.range)
    planes, packed = tables.saturation.size, np.tril_indices(base.bands + 1)
    nodes = np.concatenate([tables.nodes[..., k][packed] for k in range(planes)])
    bowed, thermal = base.diagonal == "uniform", tables.settling > 0
    second = tables.bow if bowed else tables.reversible
    written = {
        "levels": base.levels,
        "marks": tables.marks,
        "nodes": nodes,
        "bow" if bowed else "reversible": second.T.ravel(),
        "saturation": tables.saturation,
        "gained": np.append(1.0, -np.expm1(-seconds / tables.times)),
    }
    said = [f"{base.bands} bands, {base.relay} relays, {base.diagonal} diagonal"]
    if thermal:
        said.append(f"thresholds settle in {model.settling:.3g} s")
    said += [f"creep of {time:.3g} s" for time in model.times]
    count = (1 + thermal) * base.levels.size + nodes.size + second.size + 2 * planes
    extremum = (2 + planes) * numbers.size + numbers.size  # the band, padded
    low, high = base.levels[[0, -1]]
    shares = np.random.default_rng(0).beta(0.7, 0.7, _VECTORS // 2)  # loops and holds
    u = np.repeat(low + shares * (high - low), 2)
    u = numbers.array(u).astype(np.float64)
    y = model.simulate(seconds * np.arange(u.size), u)
    swing = base.swing * float(np.abs(base.weights).sum() + np.abs(model.creep).sum())
    return Parts(
        template="after_effect",
        title="a Preisach operator with after-effect",
        context={
            "tables": {name: numbers.table(values) for name, values in written.items()},
            "bands": base.bands,
            "planes": planes,
            "memory": memory,
            "slope": numbers.one(base.slope),
            "thermal": thermal,
            "lost": numbers.one(-np.expm1(-seconds / model.settling)) if thermal else "",
            "least": numbers.one(_LEAST[single]),
            **{name: name + "f" * single for name in ("exp", "log")},
            "bowed": bowed,
            "seconds": f"{seconds:.6g}",
            "about": f"{'; '.join(said)}.",
        },
        table_bytes=count * numbers.size,
        state_bytes=(memory + 1) * extremum + (planes + 3) * numbers.size,
        memory=memory,
        u=u,
        y=y,
        width=model.range[1] - model.range[0],
        inverse=inverse,
        targets=y,
        drop_error=swing / (memory - 3),
    )
