"""Control of heated wires: feedforward, observers, guards and planned sequences."""
