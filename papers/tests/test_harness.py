from multiprocessing import active_children

import worker_tasks
from papers.harness import for_each, medians


def test_medians_over_specimens():
    runs = [{"x": value, "y": {"z": [value, 1]}, "any": value > 2} for value in (1, 3, 2)]
    assert medians(runs) == {"x": 2.0, "y": {"z": [2.0, 1.0]}, "any": True}


def test_one_specimen_needs_no_other_process():
    assert list(for_each(lambda seed: seed * 2, 1, 5)) == [10]


def test_results_that_need_no_order_come_as_they_are_ready():
    results = for_each(worker_tasks.endless_but_the_second, 2, 0, ordered=False)
    assert next(results) == 1
    results.close()


def test_specimens_that_are_still_computed_end_with_the_iterator():
    before = set(active_children())
    results = for_each(worker_tasks.endless_but_the_first, 2, 0)
    assert next(results) == 0
    results.close()
    assert set(active_children()) == before
