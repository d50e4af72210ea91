"""Real instruments behind the door of `minorloop.lab.actuator`.

A driver is a `Source`, which sets an input, and a `Meter`, which reads an output; `Bench` makes an
actuator of the two, with limits, timing and the way to safety. `template` is one to copy.
"""
