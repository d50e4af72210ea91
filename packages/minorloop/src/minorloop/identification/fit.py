"""The law of a Preisach plane, and its identification from a record."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from minorloop.arrays import IntArray, Levels, check_option
from minorloop.errors import counted
from minorloop.identification import record_checks as checks
from minorloop.identification.choosing import LEVELS, Chosen, check_several_groups, choose, validate
from minorloop.identification.curves import as_curves, as_groups, check_group_sizes
from minorloop.identification.design_matrix import MOST_DENSE, PlaneSpec
from minorloop.identification.fitting import FitRecord, fit_plane
from minorloop.identification.jumps import (
    Jump,
    find_jumps,
    in_narrow_bands,
    narrow_bands,
    with_jumps,
)
from minorloop.identification.plane_result import Identification
from minorloop.identification.preparation import fit_prepared
from minorloop.identification.prior import Gaussian, Prior, Smooth
from minorloop.lab.records import Record
from minorloop.operators.plane import RELAYS, Relay
from minorloop.operators.preisach import Diagonal
from minorloop.threads import one_thread

Say: TypeAlias = Callable[[str], None]
"""Function that receives the next step of an identification, as text."""


def silent(stage: str) -> None:
    """Ignore the next step."""


@dataclass(frozen=True, eq=False)
class Plane:
    """The law of a Preisach plane: the output depends on the order of the inputs only.

    Constrained least squares on exact areas, partly covered cells included. Weights are not
    negative unless ``signed``, so that the model is monotone and can be inverted.

    Options that are ``"auto"`` are chosen by the error on left-out groups, or on contiguous parts
    of a record without groups. The results are in ``choices``. The prior is chosen otherwise,
    because parts of a record show little about inputs beyond it.

    References
    ----------
    Tan and Baras, Automatica 40, 2004: weights of a discretised plane by constrained least
    squares.

    Examples
    --------
    >>> u = np.sin(np.linspace(0.0, 20.0, 200))
    >>> ml.identify(u, u, ml.Plane(4, diagonal="reversible", lag=0)).model.bands
    4
    """

    levels: int | npt.ArrayLike | Literal["auto"] = "auto"
    """Number of bands, over the range of the input, or the (L + 1,) thresholds themselves.
    ``"auto"`` compares 25 and 50 bands, if there are enough samples. Unless the prior is
    `Gaussian`, a threshold at which the output jumps gets its own narrow band. Given thresholds do
    not change; only jumps inside their narrow bands count."""
    relay: Relay = "bipolar"
    """As in `Preisach`."""
    diagonal: Diagonal | Literal["auto"] = "auto"
    """As in `Preisach`."""
    slope: bool | Literal["auto"] = "auto"
    """Whether to fit a memoryless linear part."""
    lag: int | str = "auto"
    """Whole samples by which the output follows the input. ``"auto"`` tries 0 to 20 on the fitted
    samples. It keeps the best if that reduces the error on left-out parts to a third; or by a fifth
    both against no lag and against a delay by a travel of the input. Otherwise the lag is 0. A
    record with times may have a lag in seconds, such as ``"3 ms"``."""
    spacing: Literal["uniform", "adaptive"] = "uniform"
    """Even thresholds, or thresholds that are denser where the output is steep."""
    signed: bool = False
    """Whether weights and slope may be negative, for example for butterfly loops."""
    offset: bool = True
    """Whether to fit an offset."""

    def identify(
        self, record: Record, prior: Prior = "auto", holdout: float = 0.0, say: Say = silent
    ) -> Identification:
        """Identify the weights, as `minorloop.identify`."""
        if record.origin.identified_by is not None:
            found: Identification = record.origin.identified_by(record, self, prior, holdout)
            return found

        def fit(cut: Record, lag: int | Literal["auto"]) -> Identification:
            return replace(self, lag=lag).fit(cut, prior, holdout, say)

        prepared: Identification = fit_prepared(record, self.lag, fit)
        return prepared

    @one_thread()
    def fit(
        self, record: Record, prior: Prior = "auto", holdout: float = 0.0, say: Say = silent
    ) -> Identification:
        """Identify the weights from a record whose rows are all used, and even if there is a lag.

        Parameters and errors are as of `identify`.
        """
        inputs, outputs, coded = record.checked
        check_option("spacing", self.spacing, ("uniform", "adaptive"))
        check_option("relay", self.relay, RELAYS)
        check_option("diagonal", self.diagonal, ("uniform", "reversible", "auto"))
        slope = False if self.slope == "auto" else self.slope
        checks.check_flags(slope=slope, signed=self.signed, offset=self.offset)
        parts = as_curves(record.curves, inputs.size, record.start, record.start_of_curve)
        group = _as_groups(record.curves, record.groups, inputs.size)
        skipped = checks.as_skip(record.skip, parts.positions(inputs.size))
        fitted, held_out = checks.split(outputs, holdout, coded, skipped)
        if group is not None:
            check_several_groups(group[fitted])
        sensor, sd = checks.as_noise(record.sd, fitted)
        rows = FitRecord(
            inputs, outputs, fitted, parts, bool(self.signed), sd, 0.0, sensor, group is not None
        )
        grids = _grids(rows, self.levels, self.spacing)
        specs = self.structures(grids[0])
        automatic = len(specs) > 1 or len(grids) > 1
        delay = None if self.lag == "auto" else checks.as_lag(self.lag, inputs.size)
        chosen = Chosen(specs[0], delay or 0, ())
        if automatic or delay is None:
            chosen = choose(specs, rows, delay, group, grids[1] if len(grids) > 1 else None, say)
        spec, delay = chosen.spec, chosen.lag
        rows = rows.left_by(delay)
        held_out = held_out & (parts.positions(inputs.size) >= delay)
        jumps: tuple[Jump, ...] = ()
        if not isinstance(prior, Gaussian):
            fixed = not (isinstance(self.levels, str) or np.isscalar(self.levels))
            jumps, thresholds = _jumps(rows, delay, spec.levels, fixed)
            if jumps and thresholds.size - 1 <= MOST_DENSE:
                spec = replace(spec, levels=thresholds)
                prior = prior if isinstance(prior, Smooth) else Smooth()
        say(f"fitting {counted(spec.cells, 'cell')} to {counted(int(fitted.sum()), 'sample')}")
        found = fit_plane(spec, rows, delay, prior, group, say)
        left_out = None if group is None else validate(rows, found, delay, group, say)
        return Identification(
            model=spec.model(found.x),
            lag=delay,
            curves=parts,
            smoothness=found.smoothness,
            kkt=found.kkt,
            converged=found.converged,
            u=inputs,
            y=outputs,
            fitted=found.fitted,
            held_out=held_out,
            regression=found.regression,
            posterior=found.posterior,
            suspects=found.suspects,
            codes=coded,
            searched=self.lag == "auto",
            left_out=left_out,
            groups=group,
            skipped=int(np.count_nonzero(skipped)),
            choices=chosen.choices,
            jumps=jumps,
            ridge=found.ridge,
        )

    def structures(self, levels: Levels) -> list[PlaneSpec]:
        """Return the structures to compare, the simplest first.

        A reversible diagonal contains the slope within the levels.

        Parameters
        ----------
        levels
            Thresholds (L + 1,).
        """
        diagonals: list[Any] = [self.diagonal]
        if self.diagonal == "auto":
            diagonals = ["uniform", "reversible"]
        slopes = [False, True] if self.slope == "auto" else [bool(self.slope)]
        return [
            PlaneSpec(levels, self.relay, shape, bool(self.offset), linear)
            for shape, linear in product(diagonals, slopes)
            if not (linear and self.slope == "auto" and shape == "reversible")
        ]


def _grids(
    record: FitRecord, levels: int | npt.ArrayLike | Literal["auto"], spacing: str
) -> list[Levels]:
    """Candidates of the thresholds; given thresholds are the only candidate."""
    known = np.where(record.fitted, record.y, np.nan)
    counts = [LEVELS, 2 * LEVELS] if isinstance(levels, str) and levels == "auto" else [levels]
    return [checks.grid(record.u, known, count, spacing) for count in counts]


def _jumps(
    record: FitRecord, lag: int, levels: Levels, given: bool
) -> tuple[tuple[Jump, ...], Levels]:
    """Jumps of the output, and levels with narrow bands around them; given levels do not change."""
    if given and not narrow_bands(levels).size:
        return (), levels
    u, parts = record.curves.delayed(record.u, lag), record.curves
    jumps = find_jumps(u, record.y, record.fitted, parts, levels)
    if given:
        return in_narrow_bands(jumps, levels), levels
    return jumps, with_jumps(levels, jumps) if jumps else levels


def _as_groups(
    curves: npt.ArrayLike | None, groups: npt.ArrayLike | None, samples: int
) -> IntArray | None:
    """Number of the group of each row; curves are groups if there are no others."""
    labels, name = (curves, "curves") if groups is None else (groups, "groups")
    if labels is None:
        return None
    number = as_groups(name, labels, samples)
    check_group_sizes(name, number, np.unique(np.asarray(labels)).tolist())
    return number
