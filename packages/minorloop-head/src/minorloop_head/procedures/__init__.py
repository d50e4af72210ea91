"""Steps of an inspection that any loop drives: one without an operator, a console, a study.

A procedure is a generator: it yields a `Request`, is sent the `Reading` of the tick after it, and
returns its result; `yield from` makes it a part of another one::

    rig.run(go(angles=(0.2, 0.1)))

`InspectionRig` is such a loop. Angles are in radians, lengths in metres, times in seconds.
"""
