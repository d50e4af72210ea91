"""Tasks that import nothing, for workers whose tasks do not matter."""

import threading

from minorloop.errors import ParameterError


def warm_up():
    pass


def refuse():
    yield {"stage": "looking"}
    raise ParameterError("this is always refused")


def take(size):
    yield {"taken": len(bytearray(size))}


def write(path, size):
    with open(path, "wb") as file:
        yield {"written": file.write(bytes(size))}


def endless():
    yield {"stage": "waiting"}
    threading.Event().wait()


def endless_but_the_first(seed):
    if seed:
        threading.Event().wait()
    return seed


def endless_but_the_second(seed):
    if seed != 1:
        threading.Event().wait()
    return seed
