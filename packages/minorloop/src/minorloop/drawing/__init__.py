"""Figures of models and results, one function for each class: see `minorloop.figures`."""
