"""Without the package that an export needs, the message names the extra."""

import importlib
import sys

import pytest

from minorloop.errors import MissingExtraError
from minorloop.operators.preisach import Preisach


def test_python_control(monkeypatch):
    from minorloop.export.python_control import as_system

    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'minorloop\[control\]'"):
        as_system(Preisach([0.0, 1.0], [[1.0]]))


def test_scikit_learn(monkeypatch):
    for name in ("sklearn", "sklearn.base", "sklearn.utils.validation"):
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, "minorloop.export.sklearn", raising=False)
    with pytest.raises(MissingExtraError, match=r"pip install 'minorloop\[sklearn\]'"):
        importlib.import_module("minorloop.export.sklearn")
