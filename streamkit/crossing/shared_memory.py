"""Shared memory: integers, and a slot for one array each.

It has no name, so that nothing is left when a process dies.
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

import msgspec

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
MAX_KEPT_DESCRIPTORS = 16  # of a reader, which may keep many more arrays; a link has 8 frames on the way


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


class NumberRing:
    """Numbers from one process to another, in order, in integers that both have; each side has its own ring.

    A word is 0 while it is free, so that no order between two words matters.
    """

    def __init__(self, words: memoryview) -> None:
        self._words = words
        self._at = 0

    def put(self, numbers: deque[int]) -> None:
        """Moves numbers, none negative, into the ring while there is room."""
        while numbers and not self._words[self._at]:
            self._words[self._at] = numbers.popleft() + 1
            self._at = (self._at + 1) % len(self._words)

    def take(self) -> list[int]:
        """The numbers in the ring."""
        taken: list[int] = []
        while len(taken) < len(self._words) and (word := self._words[self._at]):
            self._words[self._at] = 0
            self._at = (self._at + 1) % len(self._words)
            taken.append(word - 1)
        return taken


class ArrayPlace(NamedTuple):
    """The place of an array: number of the slot, and the layout in it."""

    slot: int
    dtype: str
    shape: tuple[int, ...]
    strides: tuple[int, ...]


class NewSlot(msgspec.Struct, array_like=True, tag=2):
    """A slot that the reader does not know yet.

    Attributes:
        number: by which messages name it.
        size: bytes.
        forgotten: numbers of earlier slots that will not be named again.
        descriptor: of this process: to be sent with the rest, then closed; or received with the rest.
    """

    number: int
    size: int
    forgotten: tuple[int, ...]
    descriptor: int


class SlotWriter:
    """The writer's side: puts arrays into slots; makes a slot where none is free.

    The reader may keep an array for as long as it likes: its slot is then replaced by a new one, so memory
    grows by what the reader keeps, and by nothing else. An array that itself came from another process is not
    copied: the reader maps the memory in which it lies, and the array is kept until the reader releases it.
    """

    def __init__(self) -> None:
        self._slots: dict[int, Any] = {}
        self._free: list[int] = []  # the last one freed is still in the cache
        self._forwarded = weakref.WeakValueDictionary[int, Any]()
        self._kept: dict[int, list[NDArray[Any]]] = {}  # by slot that is forwarded, the arrays in use
        self._known: set[int] = set()  # to the reader
        self._size = self._next = 0

    def write(self, array: NDArray[Any]) -> tuple[ArrayPlace, NewSlot | None]:
        """Puts an array into shared memory, with its strides: another order can change sums of floats."""
        memory = _memory_to_forward(array)
        return self._copy(array) if memory is None else self._forward(array, memory)

    def release(self, number: int) -> None:
        """The reader no longer uses an array in a slot; a slot of an earlier size is forgotten."""
        if number in self._slots:
            self._free.append(number)
        elif kept := self._kept.get(number):
            kept.pop()

    def _copy(self, array: NDArray[Any]) -> tuple[ArrayPlace, NewSlot | None]:
        import numpy as np

        strides, size = _layout(array)
        if size > self._size:  # the caps have changed
            self._slots.clear()  # the reader's mappings stay while arrays use them
            self._free.clear()
            self._size = size
        made = None if self._free else self._make()
        number = self._free.pop() if made is None else made.number
        place = ArrayPlace(number, array.dtype.str, array.shape, strides)
        np.ndarray(array.shape, array.dtype, self._slots[number], 0, strides)[...] = array
        return place, made

    def _forward(self, array: NDArray[Any], memory: Any) -> tuple[ArrayPlace, NewSlot | None]:
        made, number = None, memory.numbers.get(self)
        if number is None:
            made = self._announce(len(memory), os.dup(memory.descriptor))
            number = memory.numbers[self] = made.number
            self._forwarded[number], self._kept[number] = memory, []
        self._kept[number].append(array)
        return ArrayPlace(number, array.dtype.str, array.shape, array.strides), made

    def _make(self) -> NewSlot:
        size = max(1, self._size)
        descriptor = make_memory("streamkit-frame", size)
        fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, SEALS)
        made = self._announce(size, descriptor)
        self._slots[made.number] = map_memory(descriptor, size, writable=True)
        return made

    def _announce(self, size: int, descriptor: int) -> NewSlot:
        forgotten = self._known - self._slots.keys() - set(self._forwarded)
        for number in forgotten:
            self._kept.pop(number, None)
        number, self._next = self._next, self._next + 1
        self._known = (self._known - forgotten) | {number}
        return NewSlot(number, size, tuple(forgotten), descriptor)


class SlotReader:
    """The reader's side: arrays that lie in shared memory, read-only and not copied.

    Attributes:
        released: numbers of slots that no array uses any more, to be sent to the writer.
    """

    def __init__(self) -> None:
        self.released: deque[int] = deque()
        self._slots: dict[int, Any] = {}
        self._descriptors: set[int] = set()  # those that are kept
        self._uses: dict[int, weakref.ref[NDArray[Any]]] = {}

    def add(self, slot: NewSlot) -> None:
        """Maps a new slot; takes the descriptor, which a few slots keep to be sent on.

        Raises:
            ValueError: its memory is not sealed, so that the writer could shrink it under the reader.
        """
        for number in slot.forgotten:
            self._slots.pop(number, None)  # arrays keep theirs
        descriptor = slot.descriptor
        try:
            is_sealed = fcntl.fcntl(descriptor, fcntl.F_GET_SEALS) & SEALS == SEALS
            if not is_sealed or not 0 < slot.size <= min(os.fstat(descriptor).st_size, MAX_SLOT):
                raise ValueError("shared memory for frames must be sealed and of the size announced")
            memory = map_memory(descriptor, slot.size, writable=False)
            if len(self._descriptors) < MAX_KEPT_DESCRIPTORS:
                memory.descriptor = descriptor
                memory.numbers = weakref.WeakKeyDictionary[SlotWriter, int]()
                self._descriptors.add(descriptor)
                weakref.finalize(memory, _close, descriptor, self._descriptors).atexit = False
            self._slots[slot.number] = memory
        finally:
            if descriptor not in self._descriptors:
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
        self._release_after(array, place.slot)
        return array

    def _release_after(self, array: NDArray[Any], slot: int) -> None:
        """Releases a slot once an array is gone; `weakref.finalize` takes twice as long, for each frame."""

        def release(use: weakref.ref[NDArray[Any]]) -> None:
            del self._uses[id(use)]
            self.released.append(slot)

        use = weakref.ref(array, release)
        self._uses[id(use)] = use


def _close(descriptor: int, kept: set[int]) -> None:
    """Closes a descriptor that was kept, once its memory is no longer used."""
    kept.discard(descriptor)  # before: the number may be that of another one right after
    os.close(descriptor)


def _memory_to_forward(array: NDArray[Any]) -> Any:
    """The memory of a `SlotReader` that an array begins in and whose descriptor is kept; else None."""
    import numpy as np

    base: Any = array.base
    if isinstance(base, np.ndarray):  # a view may begin inside
        base = base.base if array.ctypes.data == base.ctypes.data else None
    return base if isinstance(base, ctypes.Array) and hasattr(base, "descriptor") else None


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
