"""The output of a Preisach operator worked out the slow way, cell by cell and strip by strip."""

import numpy as np


def strips(u, low, high):
    """Staircase of switched-on relays: (beta from, beta to, alpha up to), naively kept."""
    steps, now = [], low
    for value in u:
        x = min(max(value, low), high)
        if x > now:
            steps = [(a, b, max(top, x)) for a, b, top in steps] + [(now, x, x)]
        elif x < now:
            steps = [(a, min(b, x), top) for a, b, top in steps if a < x]
        now = x
        yield list(steps)


def switched_on(steps, levels, uniform):
    """Fraction of each cell that is on."""
    bands = len(levels) - 1
    on = np.zeros((bands, bands))
    for a, b, top in steps:
        for j in range(bands):
            p, q = max(a, levels[j]), min(b, levels[j + 1])
            if q <= p:
                continue
            width = levels[j + 1] - levels[j]
            for i in range(j + 1, bands):
                height = levels[i + 1] - levels[i]
                on[i, j] += (q - p) / width * min(max((top - levels[i]) / height, 0), 1)
            end = min(top, levels[j + 1])
            if end <= p:
                continue
            q = min(q, end)
            if uniform:
                on[j, j] += ((end - p) ** 2 - (end - q) ** 2) / width**2
            else:
                on[j, j] += (q - p) / width
    return on


def outputs(model, u, past=()):
    """Outputs for an input that follows ``past``, from negative saturation."""
    levels, total = model.levels, model.weights.sum()
    y = []
    history = [*past, *u]
    for steps, value in zip(strips(history, levels[0], levels[-1]), history, strict=True):
        on = (switched_on(steps, levels, model.diagonal == "uniform") * model.weights).sum()
        relays = 2 * on - total if model.relay == "bipolar" else on
        y.append(model.offset + model.slope * value + relays)
    return np.array(y[len(past) :])
