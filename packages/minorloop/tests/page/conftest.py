"""Tests of the server are left out where the extra is missing: minorloop[page]."""

from importlib.util import find_spec

_SERVED = ["test_lab.py", "test_pages.py", "test_serving.py", "test_uploads.py"]
collect_ignore = [] if find_spec("uvicorn") else _SERVED
