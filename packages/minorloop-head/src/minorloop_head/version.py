"""The version of this package, that of minorloop."""

__version__ = "0.2.0"
