import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from minorloop import Memory, Preisach

values = st.lists(st.floats(-1.5, 1.5), max_size=40)


def remembered(history):
    """What a history leaves behind: from saturation on, the last maximum of what follows, the
    last minimum of what follows that, and so on to the present.
    """
    path = [-1.0, *np.clip(history, -1.0, 1.0).tolist()]
    ahead = path[len(path) - path[::-1].index(-1.0) :]
    kept, extreme = [-1.0], max
    while ahead and ahead[-1] != kept[-1]:
        kept.append(extreme(ahead))
        ahead = ahead[len(ahead) - ahead[::-1].index(kept[-1]) :]
        extreme = min if extreme is max else max
    return tuple(kept)


@given(values)
def test_memory_holds_extrema_that_nothing_later_exceeded(history):
    assert Memory.after(history, low=-1, high=1).extrema == remembered(history)


def test_a_memory_of_another_plane_is_clamped():
    model = Preisach([0.0, 1.0], [[1.0]])
    assert model.memory(Memory([-3.0, 0.5, 0.2])).extrema == (0.0, 0.5, 0.2)
