"""Independent judges of the head: a renderer and a wave equation that share no code with its twins."""
