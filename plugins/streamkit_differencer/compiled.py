"""Loops over pixels as machine code: one pass over a picture, without the interpreter and its lock."""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numba
from numba import types

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")

# What kernels take: pictures in memory of their own, [rows, columns], C-contiguous.
BYTES = types.Array(types.uint8, 2, "C")
FLOATS = types.Array(types.float32, 2, "C")
PAIRS = types.Array(types.uint16, 2, "C")
BLOCKS = types.Array(types.int32, 2, "C")
FLAGS = types.Array(types.boolean, 1, "C")
# A picture of somebody else's, which is only read.
INPUT = types.Array(types.uint8, 2, "C", readonly=True)
# The same, of which lines may be parts of longer ones.
VIEW = types.Array(types.uint8, 2, "A", readonly=True)
# Points, boxes, homographies.
TABLE = types.Array(types.float64, 2, "C")
# First row, row after the last, first column, column after the last.
REGION = types.UniTuple(types.int64, 4)  # type: ignore[no-untyped-call]
Region = tuple[int, int, int, int]

_kernels: list[tuple[Any, tuple[types.Type, ...]]] = []


def compiled(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """A function of plain arrays and numbers, compiled by numba when it is first called.

    The machine code is kept beside the module (or in the user's cache folder), so that only the first
    process on a machine waits for the compiler. Results are the same on every machine: no fast-math.
    Other threads run while the function does. A part of a kernel lies in the kernel's own module: numba
    looks only there for changes since the code was kept, and sees none of a constant that is imported.

    Args:
        function: Loops in the part of Python that numba compiles; it must not keep its arguments.

    Returns:
        The compiled function. A new set of argument types compiles anew.
    """
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    try:
        return numba.njit(cache=True, **options)(function)  # type: ignore[no-any-return]
    except RuntimeError:  # no folder to keep machine code in, as in a read-only container
        return numba.njit(**options)(function)  # type: ignore[no-any-return]


def kernel(
    *arguments: types.Type,
) -> Callable[[Callable[_Parameters, _Result]], Callable[_Parameters, _Result]]:
    """A compiled function that is called from Python, and the types of the arguments that it is called with.

    Args:
        arguments: numba's types, one for each argument.
    """

    def decorate(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
        result = compiled(function)
        _kernels.append((result, arguments))
        return result

    return decorate


def prepare() -> None:
    """Compiles every kernel of the plugin, or loads its machine code: no frame then waits for the compiler.

    From then on a call with other types raises a TypeError instead of compiling in mid-stream.
    """
    for function, arguments in _kernels:
        if arguments not in function.overloads:
            function.compile(arguments)
        function.disable_compile()
