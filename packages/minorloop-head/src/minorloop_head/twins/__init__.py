"""Simulated wires, heads, cameras, probes and pipes."""
