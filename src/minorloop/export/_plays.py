"""What the templates need to know of a Prandtl-Ishlinskii operator."""

from __future__ import annotations

from typing import Any

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import NotInvertibleError
from minorloop.export._tables import Numbers
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii

_VECTORS = 200


def plays_tables(
    model: PrandtlIshlinskii, numbers: Numbers, inverse: bool
) -> tuple[dict[str, Any], int, int]:
    """Context, bytes of tables, bytes of a state.

    Raises
    ------
    NotInvertibleError
        If an inverse is asked for and there is none.
    """
    if inverse and not model.invertible:
        raise NotInvertibleError(
            "the plays have no linear term or a running sum of their weights is not positive, so "
            "their C cannot have an inverse; export it without (inverse=False, --no-inverse)"
        )
    count = model.radii.size
    context = {
        "plays": count,
        "offset": numbers.one(model.offset),
        "tables": {"radii": numbers.table(model.radii), "slopes": numbers.table(model.slopes)},
    }
    return context, 2 * count * numbers.size, (count + 1) * numbers.size


def plays_vectors(model: PrandtlIshlinskii) -> FloatArray:
    """Inputs that move every play."""
    reach = 2 * float(model.radii[-1]) or 1.0
    return np.random.default_rng(0).uniform(-reach, reach, _VECTORS)
