"""Shared memory without a name and without an open descriptor: nothing is left when a process dies."""

from __future__ import annotations

import ctypes
import mmap
import os
import weakref
from typing import Any

LIBC = ctypes.CDLL(None, use_errno=True)
LIBC.mmap.restype = ctypes.c_void_p
LIBC.mmap.argtypes = [
    ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_long,
]  # fmt: skip
LIBC.munmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t]
FAILED = ctypes.c_void_p(-1).value


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
