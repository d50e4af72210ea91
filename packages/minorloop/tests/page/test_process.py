from pathlib import Path

import pytest

from minorloop.page.process import bind_to_parent


def test_a_process_is_named_after_its_part():
    before = Path("/proc/self/comm")
    if not before.exists():
        pytest.skip("only Linux names processes")
    name = before.read_text().strip()
    bind_to_parent("minorloop-test", 0)
    assert before.read_text() == "minorloop-test\n"
    bind_to_parent(name, 0)
