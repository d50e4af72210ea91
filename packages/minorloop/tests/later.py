"""Modules that are imported when a test first uses them: every worker collects every file."""

import pytest


class Later:
    """Stands for a module; a test that uses it is skipped where it is missing."""

    def __init__(self, name, reason=None):
        self._name, self._reason = name, reason

    def __getattr__(self, attribute):
        if attribute.startswith(("_", "pytest")):  # pytest looks for these as it collects
            raise AttributeError(attribute)
        module = pytest.importorskip(self._name, reason=self._reason, exc_type=ImportError)
        return getattr(module, attribute)
