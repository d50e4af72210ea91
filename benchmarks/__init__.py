"""Speed and accuracy beside what a user would do otherwise.

``python -m benchmarks`` measures everything and prints one table; ``--only operators`` (or
``identification``, ``startup``) measures a part, ``--json`` prints one JSON object instead.
Every speed is a ratio of two things timed in turn in the same run, best of several, because
machines are noisy.
"""
