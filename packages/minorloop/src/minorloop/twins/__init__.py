"""Simulated actuators, for experiments without hardware."""
