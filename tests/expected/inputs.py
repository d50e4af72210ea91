"""Records that the cases read: measured ones by their place, and ones of made-up plants."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from expected.case import MEASURED

PIEZO = "piezo_micromanipulator_minor_loops.csv"
FERRITE = "bh_mnzn_ferrite.csv"


def measured(name: str) -> str:
    """Return the place of a measured record."""
    return str(MEASURED / name)


def table(name: str, header: str, *columns: np.ndarray) -> None:
    """Write columns to a CSV file in the current folder."""
    np.savetxt(
        name, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.17g"
    )


def backlash(u: np.ndarray, radii: np.ndarray, start: float = 0.0) -> np.ndarray:
    """Return the mean of backlashes of these half-widths, sample by sample."""
    state, y = np.full(radii.size, start), np.empty(u.size)
    for k, sample in enumerate(u):
        state = np.minimum(np.maximum(state, sample - radii), sample + radii)
        y[k] = state.mean()
    return y


def walk(samples: int, seed: int) -> np.ndarray:
    """Return an input from -1 to 1 and back that then wanders between them."""
    rng = np.random.default_rng(seed)
    turns = rng.uniform(-1, 1, samples // 12)
    ends = np.concatenate([[-1.0, 1.0, -1.0], turns])
    return np.interp(np.linspace(0, ends.size - 1, samples), np.arange(ends.size), ends)


def record(name: str, samples: int = 600, seed: int = 1000, noise: float = 0.002) -> None:
    """Write a record of backlashes with noise, 100 rows a second."""
    u = walk(samples, seed)
    y = backlash(u, np.linspace(0.02, 0.6, 12), -1.0)
    y += noise * np.random.default_rng(seed + 1).standard_normal(samples)
    table(name, "t [s],voltage [V],length [um]", np.arange(samples) / 100, u, y)


def curves(name: str, seed: int = 1000) -> None:
    """Write four reversal curves of backlashes with their numbers."""
    rows = []
    for number, turn in enumerate((-0.6, -0.2, 0.2, 0.6)):
        u = np.concatenate([np.linspace(1, turn, 40), np.linspace(turn, 1, 40)])
        y = backlash(u, np.linspace(0.02, 0.6, 12), 1.0)
        y += 0.002 * np.random.default_rng(seed + number).standard_normal(u.size)
        rows.append(np.column_stack([u, y, np.full(u.size, number)]))
    table(name, "voltage [V],length [um],curve", *np.concatenate(rows).T)


def relays(name: str, seed: int = 1000) -> None:
    """Write a major loop and a half of 2,000 relays with thresholds about a coercive field."""
    rng = np.random.default_rng(seed)
    middle, half = 0.2 * rng.standard_normal(2000), np.abs(0.4 + 0.2 * rng.standard_normal(2000))
    u, on = np.interp(np.arange(180) / 60, np.arange(4), [-1, 1, -1, 1]), np.zeros(2000, bool)
    y = np.empty(u.size)
    for k, sample in enumerate(u):
        on = np.where(sample >= middle + half, True, on & (sample > middle - half))
        y[k] = on.mean()
    y += 0.002 * rng.standard_normal(u.size)
    table(name, "voltage [V],length [um]", u, y)


def raw_log(name: str, seed: int = 1000) -> None:
    """Write a log of holds of 2 s with an exponential transient, 50 rows a second."""
    levels = np.array([-1, 1, -0.8, 0.8, -0.6, 0.6, -0.4, 0.4, -0.2, 0.2, 0.0])
    settled = backlash(levels, np.linspace(0.02, 0.6, 12), -1.0)
    t, u, y, before = np.arange(0, 2, 0.02), [], [], settled[0]
    for level, value in zip(levels, settled, strict=True):
        u.append(np.full(t.size, level))
        y.append(value + (before - value) * np.exp(-t / 0.2))
        before = y[-1][-1]
    outputs = np.concatenate(y)
    outputs += 0.001 * np.random.default_rng(seed).standard_normal(outputs.size)
    rows = (np.arange(outputs.size) * 0.02, np.concatenate(u), outputs)
    table(name, "t [s],voltage [V],length [um]", *rows)


def words(name: str, text: str) -> None:
    """Write a text file in the current folder."""
    Path(name).write_text(text, encoding="utf-8")
