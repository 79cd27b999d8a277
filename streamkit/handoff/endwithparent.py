"""Processes that the kernel ends with their parent, however that ends.

As a program it becomes another one: PYTHON endwithparent.py PARENT SIGNAL PROGRAM [ARGUMENT...]. A process of
its own does this before, as `preexec_fn` may hang where the parent has several threads.
"""

import ctypes
import os
import signal
import sys
from collections.abc import Sequence

PR_SET_PDEATHSIG = 1


def end_with_parent(parent: int, number: int = signal.SIGKILL) -> bool:
    """Makes the kernel send a signal to this process when its parent ends; False if it has ended already."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, number, 0, 0, 0)
    return os.getppid() == parent


def ending_with_parent(command: Sequence[str], number: int = signal.SIGKILL) -> list[str]:
    """The command that runs another, which gets a signal when this thread, its parent, ends."""
    return [sys.executable, "-I", "-S", __file__, str(os.getpid()), str(int(number)), *command]


def main(parent: str, number: str, *command: str) -> None:
    """Becomes the program, unless the parent has ended meanwhile."""
    if end_with_parent(int(parent), int(number)):
        os.execv(command[0], command)


if __name__ == "__main__":
    main(*sys.argv[1:])
