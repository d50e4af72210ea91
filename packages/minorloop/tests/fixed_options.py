"""`identify` with which nothing is compared, for tests of a single fit."""

from functools import partial

from minorloop import identification

FIXED = {"diagonal": "uniform", "slope": False, "lag": 0}
identify = partial(identification.identify, levels=25, **FIXED)
