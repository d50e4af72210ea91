"""Steps of an inspection that any loop drives: one without an operator, a console, a study.

A procedure is a generator: it yields a `Request`, is sent the `Reading` of the tick after it, and
returns its result. Its local variables are its state, and what others look at meanwhile is a value
that it is given and keeps up to date. One is part of another by ``yield from``::

    def there_and_back(here, there):
        yield from go(there)
        now = yield Request(frame=True)
        yield from go(here)
        return now.image

`InspectionRig.run` drives one to its end; `Running` advances one by a tick at a time, and closes
it. Whoever cuts a procedure off leaves all safe: the procedure itself has nothing to undo. All
angles are in radians, lengths in metres, times in seconds.
"""
