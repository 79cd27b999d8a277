"""Functions compiled by numba: one pass over an image without the interpreter and its lock."""

import contextlib
import hashlib
from collections.abc import Callable, Iterator
from functools import lru_cache, wraps
from pathlib import Path
from threading import Lock
from typing import Any, ParamSpec, TypeVar

import numba
from numba import types
from numba.core import event
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.runtime.nrt import rtsys
from typing_extensions import override

from streamkit.geometry import boxes

# Argument types of kernels, by dtype: arrays [rows, columns], C-contiguous, in their own memory.
UINT8 = types.Array(types.uint8, 2, "C")
UINT16 = types.Array(types.uint16, 2, "C")
INT32 = types.Array(types.int32, 2, "C")
FLOAT32 = types.Array(types.float32, 2, "C")
# The same, [n].
BOOL_1D = types.Array(types.boolean, 1, "C")
UINT8_1D = types.Array(types.uint8, 1, "C")
INT64_1D = types.Array(types.int64, 1, "C")
FLOAT64_1D = types.Array(types.float64, 1, "C")
# Points, boxes, homographies.
FLOAT64 = types.Array(types.float64, 2, "C")
# A read-only image.
UINT8_READONLY = types.Array(types.uint8, 2, "C", readonly=True)
# Read-only images of any strides.
UINT8_STRIDED = types.Array(types.uint8, 2, "A", readonly=True)
FLOAT32_STRIDED = types.Array(types.float32, 2, "A", readonly=True)

# Warning where a start waits for the compiler.
_COMPILING = (
    "loops are being compiled for this machine, which takes up to some minutes, once; "
    "`streamkit prepare` does it beforehand"
)

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")

_functions: list[Any] = []  # all that are compiled, and of them those with declared arguments
_kernels: list[tuple[Any, tuple[types.Type, ...]]] = []
_preparing = Lock()


class _PackageCache(FunctionCache):
    """numba's cache of machine code, invalidated by a change of any module that the function may use.

    These are those of its own package, this one, and `streamkit.geometry`. numba itself checks the function's
    own module only, and misses changes of imported kernels and constants.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        path = Path(function.__code__.co_filename)
        if path.is_file():  # not within a zip archive
            shared = (_sources_stamp(Path(module).parent) for module in (__file__, boxes.__file__))
            stamp = _sources_stamp(_package_folder(path) or path), *shared
            name = self._impl.filename_base
            self._cache_file = IndexDataCacheFile(self._cache_path, name, stamp)  # type: ignore[no-untyped-call]

    @override
    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Loads machine code; numba's own method first imports its compiler, in half a second."""
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(signature, target_context)  # type: ignore[no-untyped-call]

    def is_empty(self) -> bool:
        """Whether there is no machine code of the function as its package is now."""
        with contextlib.suppress(OSError):
            return not self._cache_file._load_index()  # type: ignore[no-untyped-call]
        return True


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

    The machine code is cached next to the module, or in the user's cache folder, until a source that the
    function may use changes. Results are the same on every machine: no fast-math. The function runs without
    the interpreter's lock.

    Args:
        function: in the part of Python that numba compiles; it must not keep its arguments.

    Returns:
        The compiled function, compiled once for each set of argument types.
    """
    # A wrapper for callers in C would take a twentieth of the compiler's time; there are none.
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
    dispatcher: Any = numba.njit(**options)(function)
    with contextlib.suppress(RuntimeError):  # no writable folder, as in a read-only container
        dispatcher._cache = _PackageCache(function)
    _functions.append(dispatcher)
    return dispatcher  # type: ignore[no-any-return]


def kernel(
    *arguments: types.Type,
) -> Callable[[Callable[_Parameters, _Result]], Callable[_Parameters, _Result]]:
    """A compiled function that Python calls, with the types of its arguments; loaded with its first call.

    Args:
        arguments: numba's types, one for each argument.
    """

    def decorate(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
        dispatcher: Any = compiled(function)
        _kernels.append((dispatcher, arguments))

        @wraps(function)
        def call(*values: _Parameters.args, **named: _Parameters.kwargs) -> _Result:
            if not dispatcher.overloads:
                _load(dispatcher, arguments)
            return dispatcher(*values, **named)  # type: ignore[no-any-return]

        return call

    return decorate


def named_tuple(cls: type[tuple[Any, ...]], *fields: types.Type) -> types.Type:
    """The argument type of a `NamedTuple` with fields of these types."""
    return types.BaseTuple.from_types(fields, cls)  # type: ignore[no-any-return, no-untyped-call]


def _load(dispatcher: Any, arguments: tuple[types.Type, ...]) -> None:
    """Loads or compiles a kernel; from then on it refuses other types of arguments."""
    with _preparing:
        if arguments not in dispatcher.overloads:
            dispatcher.compile(arguments)
        dispatcher.disable_compile()


def prepare(package: str) -> None:
    """Compiles every kernel of a package, or loads its machine code, so that no frame waits for it.

    A call with other types raises a TypeError instead of compiling while frames stream.

    Args:
        package: its name; kernels of modules that are imported count.
    """
    for function, arguments in _kernels:
        if _package_of(function) == package:
            _load(function, arguments)


def start_kernels(
    package: str, warm_up: Callable[[], None], *, is_live: bool, report: Callable[[str], None]
) -> None:
    """Has the kernels of a package ready before the first frame: at least compiled, for a live stream loaded.

    Frames of a live stream do not wait. In a file each kernel is loaded where a frame first needs it, and one
    that none needs is not loaded at all.

    Args:
        package: its name; functions of modules that are imported count.
        warm_up: compiles or loads all of them.
        is_live: whether frames are lost if they wait.
        report: called with a warning if the compiler is waited for.
    """
    own = [function for function in _functions if _package_of(function) == package]
    if is_live or any(_is_missing(function) for function in own):
        with on_compilation(lambda: report(_COMPILING)):
            warm_up()


def _is_missing(function: Any) -> bool:
    """Whether a function has to be compiled before it can run."""
    cache = function._cache
    return not function.overloads and (not isinstance(cache, _PackageCache) or cache.is_empty())


def _package_of(function: Any) -> str:
    return str(function.py_func.__module__).partition(".")[0]


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
