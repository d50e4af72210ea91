"""Whole experiments, end to end, that print their own numbers."""
