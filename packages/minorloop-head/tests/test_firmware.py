"""The exported C on an emulated Cortex-M4F."""

import pytest

from benchmarks import firmware


@pytest.mark.parametrize("bands", [5, 20])
def test_a_step_takes_at_most_2000_instructions_and_a_state_2_kib(bands):
    missing = firmware.missing_tools()
    if missing:
        pytest.skip(f"needs {', '.join(missing)}: not installed here")
    found = firmware.count(bands)
    assert 100 < found.mean_step < found.worst_step <= 2000
    assert 100 < found.mean_aim < found.worst_aim <= 2000
    assert found.state_bytes <= 2048
    assert found.table_bytes < found.code_bytes < 6000
