"""Limit the length of a memory, as the exported C does."""

import numpy as np

from minorloop.operators.memory import Memory
from minorloop.operators.preisach import Preisach


def bounded(model: Preisach, memory: Memory, room: int) -> Memory:
    """Drop the smallest loops of a memory until it has fewer than ``room`` past extrema.

    Parameters
    ----------
    model : Preisach
        The operator; the smallest loop is that with the least sum of absolute weights.
    memory : Memory
        The memory.
    room : int
        One more than the number of extrema to keep, without the present input; at least 4.
    """
    extrema = list(memory.extrema)
    if len(extrema) <= room:
        return memory
    size = Preisach(model.levels, np.abs(model.weights), diagonal=model.diagonal)
    while len(extrema) > room:
        values = np.array(extrema[:-1])
        a, b, c, d = (values[k : values.size - 3 + k] for k in range(4))
        loss = _weight(size, a, b) - _weight(size, b, c) + _weight(size, c, d) - _weight(size, a, d)
        least = 1 + int(np.argmin(np.abs(loss)))
        del extrema[least : least + 2]
    return Memory(extrema)


def _weight(size: Preisach, p: np.ndarray, q: np.ndarray) -> np.ndarray:
    return size.everett(np.maximum(p, q), np.minimum(p, q))
