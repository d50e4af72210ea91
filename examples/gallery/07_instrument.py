"""
An instrument of your own
=========================

Any object with channels, a tick and three methods is an instrument. ``run`` holds each level of a
plan until the output settles, keeps each point with its trace, refuses what is beyond the limits,
and leaves the instrument safe. A run that was stopped continues.
"""

from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

import minorloop as ml


class Stage:
    inputs = (ml.Channel("voltage", "V", low=0.0, high=100.0),)
    outputs = (ml.Channel("position", "um"),)
    tick = 0.01

    def __init__(self, port):
        self.port, self.position = port, 0.0  # open the connection here

    def apply(self, u, duration, sample_interval):  # talk to your instrument here
        t = np.arange(1, round(duration / sample_interval) + 1) * sample_interval
        y = 0.1 * u + (self.position - 0.1 * u) * np.exp(-t / 0.3)  # a lag of 0.3 s
        self.position = y[-1]
        return ml.Record(np.full(t.size, u), y, t, "voltage [V]", "position [um]")

    def exchange(self, u):
        return float(self.apply(u, self.tick, self.tick).y[-1])

    def safe(self):
        self.apply(0.0, self.tick, self.tick)


plan = ml.Plan([0, 50, 100, 20], 4.0, input="voltage [V]")
setup = ml.Setup("my stage", "voltage [V]", "position [um]")
with (
    TemporaryDirectory() as folder,
    ml.Store.create(f"{folder}/stage.sqlite", plan, setup) as store,
):
    ml.run(Stage("COM3"), plan, store)
    points = store.points()
    traces = [store.trace(point.index) for point in points]

figure, axes = plt.subplots(figsize=(7.5, 3.6), layout="constrained")
for point, (t, y) in zip(points, traces, strict=True):
    axes.plot(point.t - point.held + t - t[0], y, color="C0")
    axes.errorbar(point.t, point.value, 3 * point.sd, fmt="o", color="C1")
    place = {"xytext": (-8, 6), "textcoords": "offset points", "ha": "right"}
    axes.annotate(f"{point.input:.0f} V: {point.verdict}", (point.t, point.value), **place)
axes.margins(y=0.12)
axes.set(xlabel="time [s]", ylabel="position [um]", title="Four holds with their settled points")
