"""The bench: actuators, records of what they did, and how a length becomes a curvature."""
