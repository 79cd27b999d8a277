"""Functions compiled by numba: one pass over an image without the interpreter and its lock."""

import contextlib
import hashlib
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any, ParamSpec, TypeVar

import numba
from numba import types
from numba.core import event
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.runtime.nrt import rtsys
from typing_extensions import override

# Argument types of kernels, by dtype: arrays [rows, columns], C-contiguous, in their own memory.
UINT8 = types.Array(types.uint8, 2, "C")
UINT16 = types.Array(types.uint16, 2, "C")
INT32 = types.Array(types.int32, 2, "C")
FLOAT32 = types.Array(types.float32, 2, "C")
BOOL_1D = types.Array(types.boolean, 1, "C")
# Points, boxes, homographies.
FLOAT64 = types.Array(types.float64, 2, "C")
# A read-only image.
UINT8_READONLY = types.Array(types.uint8, 2, "C", readonly=True)
# A read-only image of any strides.
UINT8_STRIDED = types.Array(types.uint8, 2, "A", readonly=True)

# Warning of an element whose start waits for the compiler.
COMPILING = (
    "loops are being compiled for this machine, which takes up to some minutes, once; "
    "`streamkit prepare` does it beforehand"
)

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")

_kernels: list[tuple[Any, tuple[types.Type, ...]]] = []
_preparing = Lock()


class _PackageCache(FunctionCache):
    """numba's cache of machine code, invalidated by a change of any module of the function's package.

    numba itself checks the function's own module only, and misses changes of imported kernels and constants.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        path = Path(function.__code__.co_filename)
        if path.is_file():  # not within a zip archive
            stamp = _sources_stamp(_package_folder(path) or path), _sources_stamp(Path(__file__).parent)
            name = self._impl.filename_base
            self._cache_file = IndexDataCacheFile(self._cache_path, name, stamp)  # type: ignore[no-untyped-call]

    @override
    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Loads machine code; numba's own method first imports its compiler, in half a second."""
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(signature, target_context)  # type: ignore[no-untyped-call]


@lru_cache(maxsize=64)
def _package_folder(path: Path) -> Path | None:
    """The folder of the outermost package that a module belongs to."""
    folders = [folder for folder in path.parents if (folder / "__init__.py").is_file()]
    return folders[-1] if folders else None


@lru_cache(maxsize=64)
def _sources_stamp(path: Path) -> str:
    """SHA-256 of a module, or of the names and contents of all modules in a folder and below it."""
    digest = hashlib.sha256()
    for source in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
        content = source.read_bytes()
        digest.update(f"{source.relative_to(path.parent)} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def compiled(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """A function of arrays and numbers, compiled by numba when it is first called.

    The machine code is cached next to the module, or in the user's cache folder, until a source of the
    function's package changes. Results are the same on every machine: no fast-math. The function runs without
    the interpreter's lock.

    Args:
        function: in the part of Python that numba compiles; it must not keep its arguments.

    Returns:
        The compiled function, compiled once for each set of argument types.
    """
    dispatcher: Any = numba.njit(nogil=True, error_model="numpy")(function)
    with contextlib.suppress(RuntimeError):  # no writable folder, as in a read-only container
        dispatcher._cache = _PackageCache(function)
    return dispatcher  # type: ignore[no-any-return]


def kernel(
    *arguments: types.Type,
) -> Callable[[Callable[_Parameters, _Result]], Callable[_Parameters, _Result]]:
    """A compiled function that Python calls, with the types of its arguments.

    Args:
        arguments: numba's types, one for each argument.
    """

    def decorate(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
        result = compiled(function)
        _kernels.append((result, arguments))
        return result

    return decorate


def prepare(package: str) -> None:
    """Compiles every kernel of a package, or loads its machine code, so that no frame waits for the compiler.

    From then on a call with other types raises a TypeError instead of compiling while frames stream.

    Args:
        package: its name; kernels of modules that are imported count.
    """
    with _preparing:
        for function, arguments in _kernels:
            if str(function.py_func.__module__).partition(".")[0] != package:
                continue
            if arguments not in function.overloads:
                function.compile(arguments)
            function.disable_compile()


class _CompilationListener(event.Listener):
    def __init__(self, callback: Callable[[], None]) -> None:
        self._callback: Callable[[], None] | None = callback

    def on_start(self, event: event.Event) -> None:
        callback, self._callback = self._callback, None
        if callback is not None:
            callback()

    def on_end(self, event: event.Event) -> None:
        pass


@contextlib.contextmanager
def on_compilation(callback: Callable[[], None]) -> Iterator[None]:
    """Calls `callback` once, as soon as anything within the block is compiled and not only loaded."""
    with event.install_listener("numba:compile", _CompilationListener(callback)):
        yield
