"""Thousands of damaged files and answers, and how each reader treats them.

``python -m fuzz`` with the tests folder on the path prints the counts; `make fuzz` does this for
100,000 cases, and `test_fuzz.py` for a few of them. Each case follows from its number alone, so
that a case that fails can be repeated.
"""
