"""Template context of a relay-by-relay model."""

from __future__ import annotations

import numpy as np

from minorloop.errors import NotInvertibleError, ParameterError
from minorloop.export._selftest import check_digits
from minorloop.export._tables import Numbers, Parts, wrapped
from minorloop.operators.relays import RelayModel

_VECTORS = 200
_MOST = 32_000


def relay_parts(model: RelayModel, numbers: Numbers, inverse: bool) -> Parts:
    """Context, vectors and bytes of relays.

    Raises
    ------
    NotInvertibleError
        If an inverse is asked for.
    ParameterError
        If levels coincide in the type chosen, or there are too many.
    """
    if inverse:
        raise NotInvertibleError(
            "outputs of relays on level pairs come in steps, so that their C cannot have an "
            "inverse; export it without (inverse=False, --no-inverse), or identify a Preisach model"
        )
    count = int(model.levels.size)
    levels = numbers.array(model.levels)
    if count > _MOST or not (np.diff(levels) > 0).all():
        raise ParameterError(
            f"{count} levels, of which the closest are {np.diff(model.levels).min():g} apart, "
            f"cannot be told apart; give at most {_MOST}, and export doubles"
        )
    check_digits(numbers, levels)
    swing, off = model.line()
    # How much of a column is on when its relays up to a row are; columns after each other.
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
        inputs=np.random.default_rng(0).uniform(low - 0.1 * reach, low + 1.1 * reach, _VECTORS),
        start="negative",
        template="relays",
        title="weighted relays on level pairs",
    )
