"""The laws that the paper compares with that of the head, planned powers, and margins."""
