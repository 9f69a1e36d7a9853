"""Compilation of the loops over joints, contacts, pixels and rotations in which numpy's overhead would dominate."""

from collections.abc import Callable
from typing import Any, TypeVar

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Return ``function``, compiled to machine code at its first call and cached on disk where that is possible.

    numba's "fast math" is not used, so that the same input gives the same bytes on the same machine.
    """
    made: Any
    try:
        made = numba.njit(cache=True, error_model="numpy")(function)
    except RuntimeError:  # Neither the package's folder nor the user's cache is writable.
        made = numba.njit(error_model="numpy")(function)
    return made
