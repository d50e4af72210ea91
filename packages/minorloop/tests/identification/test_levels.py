import numpy as np

from fixed_options import Plane, identify


def test_adaptive_levels_crowd_where_the_output_is_steep():
    u = np.concatenate([np.linspace(-1, 1, 500), np.linspace(1, -1, 500)])
    y = np.tanh(12 * (u - 0.1 * np.repeat([1, -1], 500)))
    grid = identify(u, y, Plane(20, spacing="adaptive")).model.levels
    steps = np.diff(grid)
    assert (grid[0], grid[-1]) == (-1, 1)
    assert steps[np.abs(grid[:-1]) < 0.2].mean() < 0.5 * steps[np.abs(grid[:-1]) > 0.6].mean()
