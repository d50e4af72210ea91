from pathlib import Path

import pytest
from msgspec import inspect as types

from minorloop_head.console.typescript import _written, typescript

PAGES = Path(__file__).resolve().parents[4] / "web" / "src" / "messages.ts"


def test_the_types_of_the_pages_are_those_of_the_server():
    stale = "run 'python -m minorloop_head.console.typescript > web/src/messages.ts'"
    assert PAGES.read_text(encoding="utf-8") == typescript(), stale


def test_a_type_that_typescript_does_not_get_is_refused():
    with pytest.raises(TypeError, match="no TypeScript"):
        _written(types.BytesType())
