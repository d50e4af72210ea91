"""Follow an input live, and ask what would happen before it does."""

import numpy as np

import minorloop as ml

levels = np.linspace(-1, 1, 21)
model = ml.Preisach.from_density(
    levels, ml.densities.GaussianDensity(coercive=0.2, spread_mean=0.3, spread_width=0.15)
)
tracker = model.track("demagnetised")
for u in (0.4, -0.2, 0.1):
    print(f"input {u:5.2f}, output {tracker.push(u):7.4f}")
print(f"0.3 would give {tracker.peek(0.3):.4f}")
print(f"0.05 more output takes an input of {tracker.aim(tracker.peek(0.1) + 0.05):.4f}")
print(f"remembered: {tracker.memory.extrema[-4:]}")
