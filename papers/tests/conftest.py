"""The command line of the papers as a user calls it, in a folder of its own."""

import pytest

from command_line import _somewhere, answer, refused, run  # noqa: F401
from papers.__main__ import main


@pytest.fixture
def program():
    """What carries out the words of a command line."""
    return main
