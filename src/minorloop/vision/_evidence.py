"""Placeholder."""

from __future__ import annotations

THRESHOLDS = {"switched": 0.0, "single": 0.0, "dither": 0.0}
WEIGHTS: dict[str, dict[str, tuple[float, dict[str, float]]]] = {
    m: {k: (0.0, {}) for k in ("dark", "bright", "either", "lit")} for m in THRESHOLDS
}
