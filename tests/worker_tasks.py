"""Tasks that import nothing, for workers whose tasks do not matter."""

from minorloop.errors import ParameterError


def warm_up():
    pass


def refuse():
    yield {"stage": "looking"}
    raise ParameterError("this is always refused")
