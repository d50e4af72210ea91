"""Template context of a Prandtl-Ishlinskii operator, with or without dead zones."""

import numpy as np

from minorloop.arrays import FloatArray
from minorloop.errors import NotInvertibleError
from minorloop.export._tables import VECTORS, Numbers, Parts
from minorloop.operators.generalised_prandtl_ishlinskii import GeneralisedPrandtlIshlinskii
from minorloop.operators.prandtl_ishlinskii import PrandtlIshlinskii


def plays_parts(
    model: PrandtlIshlinskii | GeneralisedPrandtlIshlinskii, numbers: Numbers, inverse: bool
) -> Parts:
    """Return context, inputs of the self-test and bytes of plays.

    Raises a `NotInvertibleError` if ``inverse`` is true and there is none.
    """
    if inverse and not model.invertible:
        raise NotInvertibleError(
            "the plays have no linear term, or a cumulative sum of their weights or a slope of "
            "their dead zones is not positive, so their C cannot have an inverse; export it "
            "without (inverse=False, --no-inverse)"
        )
    bent = isinstance(model, GeneralisedPrandtlIshlinskii)
    plays = model.plays if isinstance(model, GeneralisedPrandtlIshlinskii) else model
    count = plays.radii.size
    tables = {"radii": numbers.table(plays.radii), "slopes": numbers.table(plays.slopes)}
    context = {"plays": count, "offset": numbers.one(plays.offset), "bent": bent, "tables": tables}
    numbers_kept = 2 * count
    if isinstance(model, GeneralisedPrandtlIshlinskii):
        # Corners with the origin among them, and the slopes of the pieces between and beyond.
        zones = model.zones
        centre = int(np.count_nonzero(zones.knots < 0))
        corners, heights = (np.insert(x, centre, 0.0) for x in (zones.knots, zones.heights))
        gains = np.insert(zones.slopes, centre, zones.slopes[centre])
        tables |= {
            "corners": numbers.table(corners),
            "heights": numbers.table(heights),
            "gains": numbers.table(gains),
        }
        context |= {
            "corners": corners.size,
            "origin": centre,
            "shift": numbers.one(model.offset),
        }
        numbers_kept += 3 * corners.size + 1
    return Parts(
        context,
        table_bytes=numbers_kept * numbers.size,
        state_bytes=(count + 1) * numbers.size,
        memory=count,
        inputs=_inputs(plays),
        start="demagnetised",
        template="plays",
        title=f"{'bent' if bent else 'weighted'} plays, a Prandtl-Ishlinskii operator",
    )


def _inputs(model: PrandtlIshlinskii) -> FloatArray:
    """Return inputs that move every play."""
    reach = 2 * float(model.radii[-1]) or 1.0
    return np.random.default_rng(0).uniform(-reach, reach, VECTORS)
