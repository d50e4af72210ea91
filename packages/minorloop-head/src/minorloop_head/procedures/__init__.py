"""Steps of an inspection that any loop drives: a mission without an operator, a console, a study.

A procedure is frozen configuration. `begin` gives its state; `step` takes the state and a
`Reading` and returns the next state and a `Request`::

    go = Go()
    state, request = go.begin(angles=(0.2, 0.1)), Request()
    while not state.done:
        state, request = go.step(state, reading)
        ...  # carry out the request, wait for a tick, read

`InspectionRig` is that loop. All angles are in radians, lengths in metres, times in seconds.
"""
