"""Speed and accuracy beside what a user would do otherwise.

``python -m benchmarks`` measures everything and prints one table: for each thing our time, the
time of the other way, their ratio, what is required of it, and how accurate the result was.
``--only operators`` (or another part) measures that part, ``--quick`` takes small sizes, to see
that everything runs, and passes no verdicts; ``--json`` prints one JSON object instead of the
table, times in seconds. The two times of a ratio are taken in turn in the same run, best of
several, because machines are noisy; other work on the machine still shows most in the rows about
both cores, and in those in which single times are long.
"""
