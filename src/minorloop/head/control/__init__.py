"""From a wish to an input."""
