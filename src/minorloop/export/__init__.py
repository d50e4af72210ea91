"""Out of Python: models as C, as co-simulation units, and inside other libraries."""
