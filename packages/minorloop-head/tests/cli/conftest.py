"""The command line as a user calls it, in a folder of its own."""

from command_line import _somewhere, answer, model, program, refused, run  # noqa: F401
from scripted_inspection import script  # noqa: F401
