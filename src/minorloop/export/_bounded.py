"""A memory of bounded length, as the exported C keeps it."""

from __future__ import annotations

import numpy as np

from minorloop.operators.memory import Memory
from minorloop.operators.preisach import Preisach


def bounded(model: Preisach, memory: Memory, room: int) -> Memory:
    """Drop the smallest loops of a memory until it has fewer than ``room`` past extrema.

    Parameters
    ----------
    model : Preisach
        The operator; the loop is smallest whose relays weigh least, whatever their signs.
    memory : Memory
        What is remembered.
    room : int
        One more than the extrema that may be kept, the present input not counted; at least 4.
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
