"""How many threads the numerical libraries may use: one each."""

import os

VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def use_one_thread() -> None:
    """Set the libraries of this process and its children to one thread; call it before numpy is loaded.

    The matrices are small: more threads make them slower (thirty times on a busy machine), slow down everything else,
    and may round in another order, so that a result would depend on the number of cores.
    """
    for variable in VARIABLES:
        os.environ[variable] = "1"
