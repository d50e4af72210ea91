"""Depths of pits and cracks from ultrasonic echoes."""
