"""The command line as a user calls it, in a folder of its own."""

from command_line import _somewhere, answer, model, planned, program, refused, run  # noqa: F401
