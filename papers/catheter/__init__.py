"""The third paper, reproduced on simulated heads."""
