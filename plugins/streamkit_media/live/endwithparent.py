"""Runs a program that the kernel ends with its parent: PYTHON endwithparent.py PARENT PROGRAM [ARGUMENT...].

A process of its own does this before it becomes the program: `preexec_fn` may hang where the parent has
several threads.
"""

import ctypes
import os
import signal
import sys

PR_SET_PDEATHSIG = 1


def main(parent: str, *command: str) -> None:
    """Becomes the program, unless the parent has ended meanwhile."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() == int(parent):
        os.execv(command[0], command)


if __name__ == "__main__":
    main(*sys.argv[1:])
