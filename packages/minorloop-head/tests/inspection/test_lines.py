"""Each line of a journal is read as it was written, and refused beyond its bounds."""

import json
from typing import get_args

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from minorloop_head.inspection.journal import converted, plain
from minorloop_head.inspection.lines import InspectionLine, SweepLine
from minorloop_head.reconstruction.depth_map import WaterLine
from minorloop_head.ultrasound.wall_echoes import Profile

NUMBERS = st.floats(allow_nan=False)
PROFILES = st.builds(
    Profile,
    *(arrays(np.float64, shape) for shape in ((3, 2), 3, 3)),
)


def drawn(kind):
    """A strategy by a type as msgspec knows it, within its bounds."""
    info = msgspec.inspect
    if isinstance(kind, info.StructType):
        return st.fixed_dictionaries({f.name: drawn(f.type) for f in kind.fields}).map(
            lambda values: kind.cls(**values)
        )
    if isinstance(kind, info.UnionType):
        return st.one_of([drawn(each) for each in kind.types])
    if isinstance(kind, info.TupleType):
        return st.tuples(*map(drawn, kind.item_types))
    if isinstance(kind, info.ListType):
        return st.lists(drawn(kind.item_type), max_size=2)
    if isinstance(kind, info.FloatType):
        return st.floats(kind.ge, kind.le, allow_nan=False)
    if isinstance(kind, info.IntType):
        return st.integers(kind.ge, kind.le)
    if isinstance(kind, info.StrType):
        return st.just("view 1.png") if kind.pattern else st.text()
    if isinstance(kind, info.DataclassType):
        return PROFILES if kind.cls is Profile else st.builds(WaterLine, *[NUMBERS] * 3)
    simple = {info.BoolType: st.booleans(), info.NoneType: st.none(), info.BytesType: st.binary()}
    return simple.get(type(kind), st.dictionaries(st.text(), st.integers()))


def same(one, other):
    """Whether values are equal, arrays and NaN too."""
    return json.dumps(plain(one)) == json.dumps(plain(other))


@pytest.mark.parametrize("kind", sorted({*get_args(InspectionLine), *get_args(SweepLine)}, key=str))
@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_a_line_is_read_as_it_was_written(kind, data):
    line = data.draw(drawn(msgspec.inspect.type_info(kind)))
    again = converted(json.loads(json.dumps(plain(line))), kind)
    assert type(again) is kind
    assert same(again, line)
