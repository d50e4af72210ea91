"""Thousands of damaged files and answers, and how each reader treats them.

`make fuzz` runs 100,000 cases, and `test_fuzz.py` a few; each follows from its number alone.
"""
