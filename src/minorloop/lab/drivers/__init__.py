"""Real instruments as actuators, by the protocols of `minorloop.lab.actuator`.

A driver is a `Source`, which sets an input, and a `Meter`, which reads an output. `Bench` makes an
actuator of the two, with limits, timing and a safe end. Copy `template` for a driver of your own.
"""
