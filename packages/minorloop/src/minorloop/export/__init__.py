"""Export of models as C, as co-simulation units, and into other libraries."""
