"""Search for the structure of dynamics: poles before and behind an operator, dead time and creep.

Structures are fitted to a part of the record and compared by their errors on left-out pieces. A
structure is better than another if the mean difference of their squared errors on these pieces is
larger than its standard error explains. So noise neither hides a pole nor adds one.
"""

from collections.abc import Sequence

import numpy as np

from minorloop.dynamics.cascade import First
from minorloop.identification.alternation import Found, Static, alternate, earlier
from minorloop.identification.dynamic_parts import DynamicParts, DynamicRecord

_KEPT = 2
"""Number of structures with two poles that are extended to three poles."""
_BETTER, _BETTER_WITH_CREEP = 0.98, 0.8
"""Ratio of the errors below which another parameter is kept; and the same for creep, which has
several parameters and also follows other slow errors."""


def search(
    record: DynamicRecord, first: First | None, poles: int | None, most: int, static: Static
) -> list[Found]:
    """Return fits of different structures, without creep.

    Each begins from a structure with a pole less. Three poles are tried only if two poles are
    better than one, and only as extensions of the best two structures.

    ``record``: the record with left-out pieces; ``first`` {"operator", "linear"}: the part that
    comes first; None tries both; ``poles``: number of poles; None tries 0 to ``most``; ``static``:
    identification of a coarse operator.
    """
    begin = DynamicParts(record.interval, float(_delay(record, static)))
    levels = [[alternate(record, begin, static)]]
    for count in range(1, (most if poles is None else poles) + 1):
        parents = sorted(levels[-1], key=lambda one: one.left_out_error)
        parents = parents[:_KEPT] if count > _KEPT else parents
        found = _one_more(record, parents, first, static)
        levels.append(found)
        # Two poles may be better than a dead time even if one pole is not.
        if (
            poles is None
            and count > 1
            and not any(better(one, parents[0], _BETTER) for one in found if one.dynamics.plausible)
        ):
            break
    tried = [one for level in levels for one in level]
    if poles is not None:
        return [one for one in tried if one.dynamics.poles == poles]
    return [one for one in tried if one.dynamics.plausible]


def with_creep(
    record: DynamicRecord, tried: Sequence[Found], best: Found, static: Static, always: bool
) -> list[Found]:
    """Return fits with creep; an empty list if creep gains too little, unless ``always``."""
    crept = _creeping(record, best, static)
    if crept is None or not (always or better(crept, best, _BETTER_WITH_CREEP)):
        return []
    most = best.dynamics.poles + 1
    others = [
        _creeping(record, one, static)
        for one in tried
        if one is not best and 0 < one.dynamics.poles <= most
    ]
    return [crept, *(one for one in others if one)]


def simplest(tried: Sequence[Found]) -> Found:
    """Return the smallest fit, unless a larger one is clearly better."""
    ranked = sorted(tried, key=lambda one: (one.dynamics.parameters, one.left_out_error))
    best = ranked[0]
    for one in ranked[1:]:
        if one.dynamics.parameters == best.dynamics.parameters:
            continue
        if better(one, best, _BETTER):
            best = one
    return best


def better(one: Found, other: Found, ratio: float = 1.0) -> bool:
    """Whether one fit is better than another by this ratio, on left-out pieces and fitted rows.

    Over the blocks of the record, the mean difference of the squared errors on left-out pieces, or
    of their logarithms, must also be beyond chance (Student, Biometrika 6, 1908). Logarithms reduce
    the effect of a few fast blocks with most of the error. If both errors are smaller by three
    tenths, no test is needed.
    """
    from scipy.special import stdtrit

    errors = (one.left_out_error, other.left_out_error), (one.error, other.error)
    if any(own >= ratio * others for own, others in errors):
        return False
    # Ratio of the errors, on left-out pieces and on fitted rows, that is clear without a test
    if all(own < 0.7 * others for own, others in errors):
        return True
    freedom = max(one.squares.size - 1, 1)
    # Probability with which chance alone may look like the gain of another parameter
    limit = float(stdtrit(freedom, 0.999)) / np.sqrt(freedom)
    least = np.finfo(np.float64).tiny
    logarithms = np.log(np.maximum(other.squares, least) / np.maximum(one.squares, least))
    return any(
        bool(gain.mean() > limit * gain.std()) for gain in (other.squares - one.squares, logarithms)
    )


def near(one: Found, chosen: Found) -> bool:
    """Whether the left-out pieces do not distinguish another structure from the chosen one.

    A structure that contains the chosen one is always as good, and does not count, unless its poles
    replace a dead time.
    """
    pairs = zip(one.dynamics.structure, chosen.dynamics.structure, strict=True)
    other, own = one.dynamics.delay, chosen.dynamics.delay
    # Poles replace a dead time of more than a sample if the other structure has less than half of
    # it
    differs = any(a < b for a, b in pairs) or (own > 1 and other < 0.5 * own)
    return differs and not better(chosen, one)


def _one_more(
    record: DynamicRecord, parents: Sequence[Found], first: First | None, static: Static
) -> list[Found]:
    """Return the best fit of each structure with one pole more than its parents."""
    best: dict[tuple[int, int, bool], Found] = {}
    for parent in parents:
        for ahead in (False, True):
            if first is not None and ahead != (first == "linear"):
                continue
            sides = len(parent.dynamics.ahead) + ahead, len(parent.dynamics.behind) + (not ahead)
            # Most poles on one side of the operator: three, or two with poles on the other side
            if max(sides) > (2 if min(sides) else 3):
                continue
            for begin in parent.dynamics.with_another_pole(ahead):
                found = alternate(record, begin, static, parent.operator)
                known = best.get(found.dynamics.structure)
                if known is None or found.error < known.error:
                    best[found.dynamics.structure] = found
    return list(best.values())


def _creeping(record: DynamicRecord, found: Found, static: Static) -> Found | None:
    """Return a fit with creep that begins from a fit without; None if it finds no creep."""
    crept = alternate(record, found.dynamics, static, found.operator, creeping=True)
    return crept if crept.dynamics.creep is not None and crept.dynamics.plausible else None


def _delay(record: DynamicRecord, static: Static) -> int:
    """Return the delay in samples with which the operator alone fits the outputs best."""
    # Delays to compare: from 0 to a tenth of the record
    delays = np.geomspace(1, max(record.u.size // 10, 1), 12).astype(int)
    y = np.where(record.fitted, record.y, np.nan)
    errors = {int(k): static(record.u, earlier(y, int(k))).nrmse for k in (0, *delays)}
    return min(errors, key=lambda delay: errors[delay])
