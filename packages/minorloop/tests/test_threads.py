import numpy as np
from threadpoolctl import threadpool_info, threadpool_limits

from minorloop import Plane, identify
from minorloop.threads import one_thread


def blas_threads():
    ours = ("numpy", "scipy")  # others bring libraries of their own, which nothing here uses
    pools = [pool for pool in threadpool_info() if pool["user_api"] == "blas"]
    return max(
        pool["num_threads"] for pool in pools if any(name in pool["filepath"] for name in ours)
    )


def test_linear_algebra_has_one_thread_inside_and_all_after():
    np.linalg.inv(np.eye(2))
    with threadpool_limits(2, user_api="blas"):
        with one_thread():
            assert blas_threads() == 1
        assert blas_threads() == 2


def test_an_identification_has_one_thread_from_the_first_comparison_on():
    u, threads = np.random.default_rng(0).uniform(-1, 1, 200), list[int]()
    with threadpool_limits(2, user_api="blas"):
        identify(u, u, Plane(3), progress=lambda stage: threads.append(blas_threads()))
    assert set(threads) == {1}
