"""How often Python collects reference cycles: seldom, because a collection may take as long as a control period."""

import gc

OBJECTS = 50_000
"""New objects until the next collection; Python's default of 700 is reached several times in a simulator step."""


def collect_seldom() -> None:
    """Exclude existing objects from collection and make it seldom; for a process with a real-time loop.

    Reference counts free almost everything at once; cycles are freed a little later.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(OBJECTS)
