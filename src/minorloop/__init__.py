"""Hysteresis of smart actuators: from measured data to precise positioning."""
