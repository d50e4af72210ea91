"""Expected figures: what every part of the product gives for fixed inputs and seeds.

``python -m expected write`` writes them into ``tests/expected/figures``, a small text file for each
case; ``python -m expected compare`` computes them anew and prints a line for each that differs.
"""
