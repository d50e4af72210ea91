"""Identify a model from a record: one function for all laws, front ends and records."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Protocol, TypeVar, overload

import numpy.typing as npt

from minorloop.errors import ParameterError, RecordError, SignalError
from minorloop.identification.fit import Plane, Say, silent
from minorloop.identification.plane_result import Identification
from minorloop.identification.prior import Gaussian, Prior, Smooth, prior_of
from minorloop.lab.records import Record

Found = TypeVar("Found", covariant=True)


class Law(Protocol[Found]):
    """The quantities that the output of an actuator depends on, with the options of the law."""

    def identify(
        self, record: Record, prior: Prior = "auto", holdout: float = 0.0, say: Say = silent
    ) -> Found:
        """Identify a model of this law.

        Parameters
        ----------
        record : Record
            The record.
        prior, holdout
            As of `minorloop.identify`.
        say : callable
            Called with the next step, as text.
        """


@overload
def identify(
    u: Record | npt.ArrayLike,
    y: npt.ArrayLike | None = None,
    law: None = None,
    *,
    prior: Prior = "auto",
    holdout: float = 0.0,
    progress: Callable[[str], None] | None = None,
) -> Identification: ...


@overload
def identify(
    u: Record,
    y: Law[Found],
    *,
    prior: Prior = "auto",
    holdout: float = 0.0,
    progress: Callable[[str], None] | None = None,
) -> Found: ...


@overload
def identify(
    u: npt.ArrayLike,
    y: npt.ArrayLike,
    law: Law[Found],
    *,
    prior: Prior = "auto",
    holdout: float = 0.0,
    progress: Callable[[str], None] | None = None,
) -> Found: ...


def identify(
    u: Any,
    y: Any = None,
    law: Any = None,
    *,
    prior: Prior = "auto",
    holdout: float = 0.0,
    progress: Callable[[str], None] | None = None,
) -> Any:
    """Identify a model from a record.

    ``identify(record)`` and ``identify(u, y)`` identify a Preisach plane with good defaults;
    ``identify(record, law)`` and ``identify(u, y, law)`` identify the model of another law.

    Raises a `SignalError` if lengths differ, fewer than three outputs are finite, or the input or
    the output never changes; a `ParameterError` if an option is out of its range.

    Parameters
    ----------
    u : Record or (T,) array_like
        The record, as `minorloop.read` returns it; or inputs applied, in order.
    y : (T,) array_like
        Outputs, not with a record; NaN where an input was applied and no output was measured.
        Overload codes and sentinels such as 9.9e37 and -9999, far from all other outputs, count as
        not measured; they are listed in ``codes`` and in the advice.
    law : Plane, Dynamics, Viscosity or Vibration
        Law of the output; `Plane` by default.
    prior : "auto", Gaussian or Smooth
        Assumption about the plane before the record: see `Prior`.
    holdout : float
        Share of the measured samples, at the end of the record, to score and not to fit; from 0 to
        0.9.
    progress : callable, optional
        Called with the next step, as text.

    Returns
    -------
    Fit
        The model with its scores and advice, and further results of the law.

    Examples
    --------
    >>> u = np.sin(np.linspace(0.0, 20.0, 200)) * np.linspace(1.0, 0.2, 200)
    >>> plant = ml.PrandtlIshlinskii([0.0, 0.2], [1.0, 0.5])
    >>> found = ml.identify(u, plant.simulate(u), ml.Plane(8, lag=0), holdout=0.2)
    >>> found.holdout_nrmse < 0.05
    True
    """
    if isinstance(u, Record):
        record, law = u, y if law is None else law
    elif y is None or _is_law(y):
        raise ParameterError("y is missing; give the outputs, or a record of minorloop.read")
    else:
        try:
            record = Record(u, y)
        except RecordError as error:
            raise SignalError(str(error)) from None
    if law is not None and not _is_law(law):
        raise ParameterError(
            f"the law is {_short(law)}; give Plane(), Dynamics(), Viscosity() or Vibration(); "
            "times and other outputs belong in Record(u, y, t)"
        )
    if prior != "auto" and not isinstance(prior, Gaussian | Smooth):
        raise ParameterError(f'prior is {_short(prior)}; give "auto", Gaussian() or Smooth()')
    return (law or Plane()).identify(record, prior, holdout, progress or silent)


def _is_law(value: object) -> bool:
    return hasattr(value, "identify") and not isinstance(value, type)


def _short(value: object) -> str:
    """Return a value in a few words."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 40 else f"{text[:37]}..."


@dataclass(frozen=True, eq=False)
class Options:
    """Options of a front end, sorted by the objects to which they belong."""

    law: Plane
    """The operator."""
    prior: Prior
    """Assumption about the plane before the record."""
    holdout: float
    """Share of the measured samples to score."""
    of_record: Mapping[str, Any]
    """Parameters of `Record`."""

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> "Options":
        """Sort options by name: of `Plane`, `prior_of` and `Record`, ``holdout`` and ``noise``.

        Raises a `ParameterError` if there is no option of a name.
        """
        given = {name: value for name, value in options.items() if value is not None}
        prior = {name: given.pop(name) for name in ("prior", "smoothness", "mean") if name in given}
        law = {one.name: given.pop(one.name) for one in fields(Plane) if one.name in given}
        holdout = given.pop("holdout", 0.0)
        of_record = {name: given.pop(name) for name in _OF_RECORD if name in given}
        if "noise" in given:
            of_record["sd"] = given.pop("noise")
        if given:
            raise ParameterError(f"there is no option {next(iter(given))!r} of identify")
        return cls(Plane(**law), prior_of(**prior), holdout, of_record)

    def identify(self, record: Record, say: Say = silent) -> Identification:
        """Identify the operator from a record."""
        return self.law.identify(record.replace(**self.of_record), self.prior, self.holdout, say)


_OF_RECORD = ("start", "start_of_curve", "skip", "curves", "groups")
"""Options of front ends that are parameters of `Record`."""
