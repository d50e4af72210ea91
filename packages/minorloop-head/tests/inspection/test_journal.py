"""A journal is written by one program at a time."""

import pytest

from minorloop.errors import OutputError
from minorloop_head.inspection.journal import Journal


def test_a_second_program_does_not_write_into_the_folder(tmp_path):
    first = Journal(tmp_path, {})
    with pytest.raises(OutputError, match="another program writes to"):
        Journal(tmp_path, {})
    first.close()
    Journal(tmp_path, {}).close()
