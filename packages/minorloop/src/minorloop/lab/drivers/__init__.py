"""Real instruments as actuators, by the protocols of `minorloop.lab.actuator`.

A driver is a `Source`, which sets inputs, and a `Meter`, which reads outputs. `Bench` makes an
actuator of the two, with limits, timing and a safe end. Copy `template` for a driver of your own.
The driver of a device with several channels is a `Device`; `bench_file` wires such devices to the
channels of a bench.
"""
