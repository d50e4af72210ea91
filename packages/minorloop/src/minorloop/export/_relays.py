"""Template context of a relay-by-relay model."""

import numpy as np

from minorloop.errors import NotInvertibleError, ParameterError
from minorloop.export._selftest import check_digits
from minorloop.export._tables import VECTORS, Numbers, Parts, wrapped
from minorloop.operators.relays import RelayModel

_MOST_LEVELS = 32_000
"""Numbers of levels fit into 16 bits with sign."""


def relay_parts(model: RelayModel, numbers: Numbers, inverse: bool) -> Parts:
    """Return context, inputs of the self-test and bytes of relays.

    Raises a `NotInvertibleError` if ``inverse`` is true; a `ParameterError` if levels coincide in
    the type of the C, or there are too many.
    """
    if inverse:
        raise NotInvertibleError(
            "outputs of relays on level pairs come in steps, so that their C cannot have an "
            "inverse; export it without (inverse=False, --no-inverse), or identify a Preisach model"
        )
    count = int(model.levels.size)
    levels = numbers.array(model.levels)
    if count > _MOST_LEVELS or not (np.diff(levels) > 0).all():
        raise ParameterError(
            f"{count} levels, of which the closest are {np.diff(model.levels).min():g} apart, are "
            f"too many or too close for a {numbers.type}; give at most {_MOST_LEVELS}, and export "
            "doubles"
        )
    check_digits(numbers, levels)
    swing, off = model.line()
    # Cumulative weights of each column, which are on up to a row; columns after each other.
    columns = np.cumsum(model.weights, axis=0)
    packed = np.concatenate([columns[b:, b] for b in range(count)])
    begins = np.cumsum([0, *range(count, 1, -1)])
    context = {
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
    }
    whole = 2 * count + 2
    reach = float(np.ptp(model.levels))
    low = float(model.levels[0])
    return Parts(
        context,
        table_bytes=numbers.size * (count + packed.size) + 4 * count,
        state_bytes=-(-whole // numbers.size) * numbers.size + numbers.size,
        memory=count,
        inputs=np.random.default_rng(0).uniform(low - 0.1 * reach, low + 1.1 * reach, VECTORS),
        start="negative",
        template="relays",
        title="weighted relays on level pairs",
    )
