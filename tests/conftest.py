"""What every test shares: repeatable examples, figures without a screen, measured data."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

os.environ["MPLBACKEND"] = "Agg"
# The tests share the cores already: threads of their algebra would only wait for one another. Set
# before NumPy is imported, here and in every process that a test starts.
for library in ("OMP", "OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

settings.register_profile("repeatable", deadline=None, derandomize=True, max_examples=60)
settings.load_profile("repeatable")

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data():
    """Folder of measured records, beside the repository."""
    if not SHARED_DATA.is_dir():
        pytest.skip("needs the measured records in ../shared/data, which are not here")
    return SHARED_DATA
