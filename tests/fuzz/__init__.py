"""Damaged files and answers, thousands of them, and what becomes of each at the doors.

``python -m fuzz`` with the tests folder on the path prints the counts; `make fuzz` does that for
100,000 cases, and `test_fuzz.py` for a few of them. Each case has a number, from which alone it
is made, so that one which goes wrong can be looked at again.
"""
