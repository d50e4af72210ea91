"""The bench: actuators, their records, and the conversion of readings."""
