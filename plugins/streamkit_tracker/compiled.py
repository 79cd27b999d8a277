"""Loops over pixels as machine code: one pass over a picture, without the interpreter and its lock."""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numba

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")


def compiled(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """A function of plain arrays and numbers, compiled by numba when it is first called.

    The machine code is kept beside the module (or in the user's cache folder), so that only the first
    process on a machine waits for the compiler. Results are the same on every machine: no fast-math.
    Other threads run while the function does. Elements call each such function once in `start`, so that
    no frame of a live feed waits for the compiler.

    Args:
        function: Loops in the part of Python that numba compiles; it must not keep its arguments.

    Returns:
        The compiled function. A new set of argument types compiles anew: callers pass one.
    """
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    try:
        return numba.njit(cache=True, **options)(function)  # type: ignore[no-any-return]
    except RuntimeError:  # no folder to keep machine code in, as in a read-only container
        return numba.njit(**options)(function)  # type: ignore[no-any-return]
