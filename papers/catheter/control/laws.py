"""The laws of the paper by their names: that of the head, and its rivals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from minorloop_head.control.head import Law
from minorloop_head.control.observer import ObserverControl
from minorloop_head.heated_wire import HeatedWire
from papers.catheter.control.adaptive import AdaptiveControl
from papers.catheter.control.feedforward import Feedforward
from papers.catheter.control.internal_model import InternalModel
from papers.catheter.control.model_reference import ModelReference
from papers.catheter.control.pi import FeedforwardPI, ProportionalIntegral


def _without_model(wire: HeatedWire, **options: Any) -> ProportionalIntegral:
    return ProportionalIntegral(**options)


def _adaptive(wire: HeatedWire, **options: Any) -> AdaptiveControl:
    return AdaptiveControl(control=ObserverControl(wire=wire, **options))


LAWS: Mapping[str, Law] = {
    "observer": ObserverControl,
    "feedforward": Feedforward,
    "pi": _without_model,
    "internal_model": InternalModel,
    "adaptive": _adaptive,
    "feedforward_pi": FeedforwardPI,
    "model_reference": ModelReference,
}
"""The first is that of the head; the adaptive one has its options from the law that it adapts."""
