"""Correlation of a template with each place of an area, against each place by itself."""

import numpy as np
import pytest

from minorloop_head.vision import _track_kernels as kernels


@pytest.mark.parametrize(
    ("template", "places"), [((24, 24), (29, 29)), ((7, 5), (3, 9)), ((8, 19), (1, 1))]
)
@pytest.mark.parametrize("unseen", [0.0, 0.1])
def test_scores_are_the_correlations_of_what_is_seen(template, places, unseen):
    rng = np.random.default_rng(3)
    form = rng.normal(size=template).astype(np.float32)
    area = rng.normal(size=np.add(template, places) - 1).astype(np.float32)
    area[rng.random(area.shape) < unseen] = np.nan
    scores = np.empty(places)
    kernels.correlate(area, form, scores)
    for i, j in np.ndindex(places):
        part = area[i : i + template[0], j : j + template[1]]
        seen = np.isfinite(part)
        plain = np.corrcoef(part[seen], form[seen])[0, 1] if seen.mean() >= 0.7 else -1.0
        assert scores[i, j] == pytest.approx(plain, abs=1e-5)
