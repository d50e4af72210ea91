"""Figures of models and results, one function for each class.

The methods ``.plot()`` of models and results, and notebooks, look up their function here.
Matplotlib is imported only when something is drawn.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__all__ = ["draw"]

_FUNCTIONS = {
    "Preisach": "operators.draw_preisach",
    "RelayModel": "operators.draw_operator",
    "PrandtlIshlinskii": "operators.draw_operator",
    "GeneralisedPrandtlIshlinskii": "operators.draw_operator",
    "Polynomial": "operators.draw_operator",
    "Inversion": "operators.draw_inversion",
    "Linear": "dynamics.draw_linear",
    "CascadeInversion": "dynamics.draw_cascade_inversion",
    "CreepFit": "dynamics.draw_creep_fit",
    "Identification": "identification.draw_identification",
    "DynamicIdentification": "dynamics.draw_dynamic_identification",
    "AfterEffect": "after_effect.draw_after_effect",
    "AfterEffectIdentification": "after_effect.draw_after_effect_identification",
    "OscillatorIdentification": "oscillator.draw_oscillator_identification",
    "DataSheetModel": "identification.draw_data_sheet",
    "Prediction": "identification.draw_prediction",
    "ExcitationReport": "identification.draw_excitation",
    "FrequencyResponse": "linear.draw_frequency_response",
    "RationalFit": "linear.draw_rational_fit",
    "LinearFit": "linear.draw_linear_fit",
    "StepResponse": "linear.draw_step_response",
    "Reduction": "lab.draw_reduction",
    "ModelScore": "identification.draw_score",
}


def draw(result: object, **options: Any) -> Any:
    """Return the figure of a model or a result.

    Parameters
    ----------
    result : model or result
        An object of one of the classes above.
    **options
        Options of this method, such as ``input_label`` and ``output_label``.

    Returns
    -------
    matplotlib.figure.Figure
    """
    module, _, function = _FUNCTIONS[type(result).__name__].partition(".")
    return getattr(import_module(f"{__name__}.{module}"), function)(result, **options)
