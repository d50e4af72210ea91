"""Budget of an adaptive run, and what its points show when it is over."""

from collections.abc import Sequence
from dataclasses import dataclass

from minorloop.errors import MinorloopError, ParameterError
from minorloop.identification.adaptive import REPEATS, VALIDATION, Adaptive, Validation
from minorloop.identification.advising import fault_warnings
from minorloop.identification.design import budget

_FEWEST = 3
"""Holds of the design that a budget in hours must leave, as `budget` requires of one in holds."""


@dataclass(frozen=True)
class RunFindings:
    """What an adaptive run shows."""

    holds: int
    """Holds that the model was fitted to."""
    outliers: tuple[int, ...]
    """Holds left out of the fit: not measured, or far outside their band."""
    repeated: tuple[int, ...]
    """Those of ``outliers`` that were measured again at once."""
    changes: tuple[int, ...]
    """Holds that contradict the model although their repetition gave the same."""
    validation: Validation | None
    """Score on the holds that were never fitted; None where there are none yet."""
    warnings: tuple[str, ...]
    """Why the model is not to be trusted."""


def design_holds(holds: int | None, hours: float | None, hold: float) -> int:
    """Return how many holds of a budget the design may choose.

    Raises a `ParameterError` if both or neither are given, or the budget is too small.

    Parameters
    ----------
    holds : int, optional
        Holds to choose; those of validation and repetitions come on top.
    hours : float, optional
        All there is, validation and repetitions included.
    hold : float
        Longest hold, in seconds.
    """
    count = budget(holds, hours, hold)
    if hours is None:
        return count
    least = VALIDATION + REPEATS + _FEWEST
    if count < least:
        raise ParameterError(
            f"{hours:g} h are {count} holds of {hold:g} s; {VALIDATION} of them are for validation "
            f"and {REPEATS} for repetitions; give {least * hold / 3600:.3g} h or more"
        )
    return count - VALIDATION - REPEATS


def findings(chooser: Adaptive, u: Sequence[float], y: Sequence[float]) -> RunFindings:
    """Return what the points of an adaptive run show.

    Parameters
    ----------
    chooser : Adaptive
        What chose the inputs.
    u, y : (n,) array_like
        Inputs and settled outputs; y is NaN where nothing was measured.
    """
    roles = chooser.roles(u, y)
    outliers = [k for k, role in enumerate(roles) if role == "outlier"]
    return RunFindings(
        holds=sum(role in ("design", "repeat") for role in roles),
        outliers=tuple(outliers),
        repeated=tuple(k for k in outliers if k + 1 < len(u) and u[k] == u[k + 1]),
        changes=tuple(chooser.changes(u, y)),
        validation=chooser.validation(u, y),
        warnings=tuple(warnings(chooser, u, y)),
    )


def warnings(chooser: Adaptive, u: Sequence[float], y: Sequence[float]) -> list[str]:
    """Return why the model of an adaptive run is not to be trusted; one sentence each.

    Parameters are as of `findings`.
    """
    said = [
        f"hold {k + 1} contradicts the model, and its repetition gave the same: the actuator or "
        f"its sensor changed at about hold {k + 1}, or a Preisach model cannot follow it; the "
        "bands are widened by this contradiction"
        for k in chooser.changes(u, y)
    ]
    found = chooser.validation(u, y)
    if found is not None and not found.trusted:
        said.append(
            f"do not trust this model: {found.covered} of {found.measured.size} validation holds "
            f"lie within their 90 % bands, with an error of {found.nrmse:.2%} of range"
        )
    try:
        return [*said, *fault_warnings(chooser.identification(u, y))]
    except MinorloopError:
        return said  # Too few points for a model yet.
