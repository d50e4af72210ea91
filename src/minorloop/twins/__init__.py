"""Physics to experiment on when no hardware is there."""
