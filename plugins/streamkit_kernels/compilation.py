"""Functions compiled by numba: one pass over a picture, without the interpreter and its lock."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any, ParamSpec, TypeVar

import numba
from numba import types
from numba.core import event

# What an element says while it prepares.
COMPILING = (
    "loops are being compiled for this machine, which takes up to some minutes, once; "
    "`streamkit prepare` does it beforehand"
)

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")

_kernels: list[tuple[Any, tuple[types.Type, ...]]] = []
_preparing = Lock()


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


def prepare(package: str) -> None:
    """Compiles every kernel of a package, or loads its machine code: no frame then waits for the compiler.

    From then on a call with other types raises a TypeError instead of compiling in mid-stream.

    Args:
        package: its name; kernels count whose modules are imported.
    """
    with _preparing:
        for function, arguments in _kernels:
            if str(function.py_func.__module__).partition(".")[0] != package:
                continue
            if arguments not in function.overloads:
                function.compile(arguments)
            function.disable_compile()


class _Telling(event.Listener):
    def __init__(self, tell: Callable[[], None]) -> None:
        self._tell: Callable[[], None] | None = tell

    def on_start(self, event: event.Event) -> None:
        tell, self._tell = self._tell, None
        if tell is not None:
            tell()

    def on_end(self, event: event.Event) -> None:
        pass


@contextmanager
def telling(tell: Callable[[], None]) -> Iterator[None]:
    """Calls `tell`, once, as soon as something within the block has to be compiled, not only loaded."""
    with event.install_listener("numba:compile", _Telling(tell)):
        yield
