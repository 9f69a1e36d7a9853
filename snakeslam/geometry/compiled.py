"""Compiling the few loops over joints, contacts and rotations that are too small for numpy to be quick at."""

from collections.abc import Callable
from typing import Any, TypeVar

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Return ``function`` compiled to machine code at its first call, and kept on disk where there is a place for it.

    Without numba's "fast math": the same input gives the same bytes on the same machine.
    """
    made: Any
    try:
        made = numba.njit(cache=True, error_model="numpy")(function)
    except RuntimeError:  # neither the package's folder nor the user's cache can be written
        made = numba.njit(error_model="numpy")(function)
    return made
