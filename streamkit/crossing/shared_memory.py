"""Shared memory: integers, and a slot for one array each.

It has no name and no open descriptor, so that nothing is left when a process dies.
"""

from __future__ import annotations

import ctypes
import fcntl
import math
import mmap
import os
import weakref
from collections import deque
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from numpy.typing import NDArray

LIBC = ctypes.CDLL(None, use_errno=True)
LIBC.mmap.restype = ctypes.c_void_p
LIBC.mmap.argtypes = [
    ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_long,
]  # fmt: skip
LIBC.munmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t]
FAILED = ctypes.c_void_p(-1).value
SEALS = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL
MAX_SLOT = 1 << 31  # bytes


def make_memory(name: str, size: int) -> int:
    """The descriptor of new memory of `size` bytes, all zero, for the caller to close."""
    descriptor = os.memfd_create(name, os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    os.ftruncate(descriptor, size)
    return descriptor


def map_memory(descriptor: int, size: int, *, writable: bool) -> Any:
    """Maps memory that another process has, too; it is unmapped with the last object that uses it.

    Python's `mmap` is not used because it keeps the descriptor open, and there may be one for each frame.

    Returns:
        A ctypes array of `size` bytes. Writing to it ends the process unless it is `writable`.

    Raises:
        OSError: the kernel refuses.
    """
    access = mmap.PROT_READ | (mmap.PROT_WRITE if writable else 0)
    address = LIBC.mmap(None, size, access, mmap.MAP_SHARED, descriptor, 0)
    if address == FAILED:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    memory = (ctypes.c_ubyte * size).from_address(address)
    weakref.finalize(memory, LIBC.munmap, address, size).atexit = False
    return memory


def make_numbers(count: int) -> tuple[memoryview, int]:
    """Integers (int64, zero) that outlive the processes that share them.

    Returns:
        The integers, and the descriptor to be sent to the other processes and then closed.
    """
    descriptor = make_memory("streamkit-numbers", 8 * count)
    return map_numbers(descriptor, count), descriptor


def map_numbers(descriptor: int, count: int) -> memoryview:
    """The integers of another process's `make_numbers`."""
    return memoryview(map_memory(descriptor, 8 * count, writable=True)).cast("B").cast("q")


class ArrayPlace(NamedTuple):
    """Where an array lies: number of the slot, and the layout in it."""

    slot: int
    dtype: str
    shape: tuple[int, ...]
    strides: tuple[int, ...]


class NewSlot(NamedTuple):
    """A slot that the reader does not know yet: its number, size (bytes) and descriptor."""

    number: int
    size: int
    descriptor: int


class SlotWriter:
    """The writer's side: copies arrays into free slots; makes a slot where none is free.

    The reader may keep an array for as long as it likes: its slot is then replaced by a new one, so memory
    grows by what the reader keeps, and by nothing else.
    """

    def __init__(self) -> None:
        self._slots: dict[int, Any] = {}
        self._free: list[int] = []  # the last one freed is still in the cache
        self._size = self._next = 0

    def write(self, array: NDArray[Any]) -> tuple[ArrayPlace, NewSlot | None]:
        """Copies an array into shared memory, with its strides: another order can change sums of floats.

        The descriptor of a new slot is to be sent, then closed.
        """
        import numpy as np

        strides, size = _layout(array)
        if size > self._size:  # the caps have changed; the reader drops its slots, too, at the larger new one
            self._slots.clear()  # the reader's mappings stay
            self._free.clear()
            self._size = size
        made = None if self._free else self._make()
        number = self._free.pop() if made is None else made.number
        place = ArrayPlace(number, array.dtype.str, array.shape, strides)
        np.copyto(np.ndarray(array.shape, array.dtype, self._slots[number], 0, strides), array)
        return place, made

    def release(self, number: int) -> None:
        """The reader no longer uses a slot; one of an earlier size is forgotten."""
        if number in self._slots:
            self._free.append(number)

    def _make(self) -> NewSlot:
        number, size = self._next, max(1, self._size)
        self._next += 1
        descriptor = make_memory("streamkit-frame", size)
        fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, SEALS)
        self._slots[number] = map_memory(descriptor, size, writable=True)
        return NewSlot(number, size, descriptor)


class SlotReader:
    """The reader's side: arrays that lie in shared memory, read-only and not copied.

    Attributes:
        released: numbers of slots that no array uses any more, to be sent to the writer.
    """

    def __init__(self) -> None:
        self.released: deque[int] = deque()
        self._slots: dict[int, Any] = {}

    def add(self, number: int, size: int, descriptor: int) -> None:
        """Maps a new slot; closes the descriptor.

        Raises:
            ValueError: its memory is not sealed, so that the writer could shrink it under the reader.
        """
        try:
            is_sealed = fcntl.fcntl(descriptor, fcntl.F_GET_SEALS) & SEALS == SEALS
            if not is_sealed or not 0 < size <= min(os.fstat(descriptor).st_size, MAX_SLOT):
                raise ValueError("shared memory for frames must be sealed and of the size announced")
            if self._slots and size > len(next(iter(self._slots.values()))):
                self._slots.clear()  # the writer has given up the smaller ones; arrays keep theirs
            self._slots[number] = map_memory(descriptor, size, writable=False)
        finally:
            os.close(descriptor)

    def read(self, place: ArrayPlace) -> NDArray[Any]:
        """The array at a place; its slot is released with the last array that shares its memory.

        Raises:
            ValueError: there is no such slot, or the array does not fit in.
        """
        import numpy as np

        memory = self._slots.get(place.slot)
        dtype = np.dtype(place.dtype)
        if memory is None or dtype.hasobject or math.prod(place.shape) * dtype.itemsize > len(memory):
            raise ValueError(f"there is no array at {place}")
        # Views of a view have the outermost array of memory as base, so it lives as long as any of them.
        array: NDArray[Any] = np.ndarray(place.shape, dtype, memory, 0, place.strides)
        array.flags.writeable = False
        weakref.finalize(array, self.released.append, place.slot).atexit = False
        return array


def _layout(array: NDArray[Any]) -> tuple[tuple[int, ...], int]:
    """Strides of the copy and its extent, bytes: those of the array unless they leave large gaps."""
    if array.size and array.flags.c_contiguous:
        return array.strides, array.nbytes
    extent = array.itemsize + sum(
        (length - 1) * step for length, step in zip(array.shape, array.strides, strict=True)
    )
    is_plain = array.size > 0 and all(step > 0 for step in array.strides)
    if is_plain and array.nbytes <= extent <= 2 * array.nbytes:
        return array.strides, extent
    strides, size = [], array.itemsize
    for length in reversed(array.shape):
        strides.append(size)
        size *= length
    return tuple(reversed(strides)), max(1, array.nbytes)
