"""Priors of an identification: what is assumed of the plane before the record."""

from dataclasses import dataclass
from typing import Literal, TypeAlias, get_args

from minorloop.arrays import check_option
from minorloop.errors import ParameterError

Mean: TypeAlias = Literal["zero", "ridge"]


@dataclass(frozen=True)
class Gaussian:
    """The prior of `minorloop.identification.prior`.

    Raises
    ------
    ParameterError
        If there is no such mean.
    """

    mean: Mean = "zero"
    """Mean of the prior. ``"ridge"``: a parametric ridge fitted to the record, of the kind of
    greatest marginal likelihood, or zero if none is more likely; about it the weights vary. It
    helps where the record leaves much of the plane open, such as one major loop."""

    def __post_init__(self) -> None:
        check_option("mean", self.mean, get_args(Mean))


@dataclass(frozen=True)
class Smooth:
    """A penalty on differences between neighbouring cells."""

    strength: float | Literal["auto"] = "auto"
    """Defined in `minorloop.identification.least_squares`; 0.0 for none. ``"auto"`` chooses by
    prediction of contiguous segments held out of the fitted samples."""


Prior: TypeAlias = Literal["auto"] | Gaussian | Smooth
"""``"auto"``: `Gaussian`, except where the output jumps, where the samples determine a plane that
reproduces them to rounding, for more than 300 bands, or where the input reverses so often that a
plane of more than 64 levels would need large dense matrices; for 51 to 64 levels and such an input,
only for fewer than three samples per unknown or where more than a tenth of the cells is not
excited."""


def prior_of(
    prior: str = "auto", smoothness: float | Literal["auto"] = "auto", mean: Mean = "zero"
) -> Prior:
    """Return the prior that options of these names say, as front ends have them.

    Raises a `ParameterError` if there is none, or options contradict each other.

    Parameters
    ----------
    prior : {"auto", "gaussian", "none"}
        Which prior.
    smoothness : float or "auto"
        Strength of `Smooth`.
    mean : {"zero", "ridge"}
        Of `Gaussian`.
    """
    check_option("prior", prior, ("auto", "gaussian", "none"))
    plain = prior == "none" or smoothness != "auto"
    if mean != "zero" and plain:
        other = 'prior "none"' if prior == "none" else f"smoothness {smoothness!r}"
        raise ParameterError(
            f"mean is {mean!r}, the mean of a prior, and there is none with {other}; "
            "leave one of them out"
        )
    if prior == "gaussian" and smoothness != "auto":
        raise ParameterError(
            f'smoothness is {smoothness!r} and prior is "gaussian"; give one of them'
        )
    if plain:
        return Smooth(smoothness)
    return Gaussian(mean) if prior == "gaussian" or mean != "zero" else "auto"
