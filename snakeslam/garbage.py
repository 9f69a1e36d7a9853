"""When Python looks for cycles of garbage: seldom, because a look costs a step its time."""

import gc

OBJECTS = 50_000
"""New objects until the next look; Python's own 700 come up several times in a step of the simulator."""


def collect_seldom() -> None:
    """Leave what there is, modules above all, out of the looks, and have them seldom; for a process that loops.

    Counted references free almost everything; what is left waits a little longer.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(OBJECTS)
