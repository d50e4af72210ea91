"""
Firmware
========

A model becomes C99 without allocation. Here the C is compiled for this machine, in single
precision as on a microcontroller, and asked for the input of each target: ``aim`` is the exact
inverse, ``step`` updates the memory.
"""

import ctypes
import subprocess
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

import minorloop as ml
from minorloop.export.c99 import export_c

density = ml.densities.GaussianDensity(coercive=0.2, spread_mean=0.3, spread_width=0.15)
model = ml.Preisach.from_density(np.linspace(-1, 1, 21), density)
targets = (
    0.4 * np.array(model.range[1]) * np.sin(np.linspace(0, 12, 400)) * np.linspace(1, 0.2, 400)
)

with TemporaryDirectory() as folder:
    code = export_c(model, folder, float32=True)
    build = ["cc", "-O2", "-shared", "-fPIC", "minorloop.c", "-lm", "-o", "model.so"]
    subprocess.run(build, cwd=folder, check=True)
    device = ctypes.CDLL(f"{folder}/model.so")
print(f"{code.table_bytes} bytes of tables, {code.state_bytes} bytes of state")

for function in (device.minorloop_aim, device.minorloop_step):
    function.argtypes, function.restype = (ctypes.c_void_p, ctypes.c_float), ctypes.c_float
state = ctypes.create_string_buffer(code.state_bytes)
device.minorloop_reset(state)
inputs = []
for target in targets:
    inputs.append(device.minorloop_aim(state, target))
    device.minorloop_step(state, inputs[-1])

error = (model.simulate(inputs) - targets) / np.ptp(model.range)
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
left.plot(inputs, targets)
left.set(xlabel="input from the C code", ylabel="output", title="The path of inputs")
right.plot(error)
right.set(xlabel="target number", ylabel="error, share of range", title="Error of single precision")
