"""Independent judges of the head: a renderer and a wave equation."""
