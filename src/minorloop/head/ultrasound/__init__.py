"""What echoes say of a wall."""
