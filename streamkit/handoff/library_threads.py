"""How many threads libraries may start: processes that work at the same time share the cores."""

from __future__ import annotations

import os
import sys

CORES = "STREAMKIT_CORES"  # those of a process among several
# Linear algebra of elements is on small matrices, which more threads slow down.
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
ONE_A_CORE = (CORES, "OPENCV_FOR_THREADS_NUM", "NUMBA_NUM_THREADS")


def available_cores() -> int:
    """The cores for the threads of this process: all that it may run on, or its share of them."""
    cores = len(os.sched_getaffinity(0))
    share = os.environ.get(CORES, "")
    return min(cores, int(share)) if share.isdigit() and int(share) else cores


def thread_variables(processes: int) -> dict[str, str]:
    """The environment in which libraries start as many threads as the cores of one process allow.

    Args:
        processes: how many work at the same time.
    """
    share = str(max(1, len(os.sched_getaffinity(0)) // processes))
    return dict.fromkeys(ONE_THREAD, "1") | dict.fromkeys(ONE_A_CORE, share)


def share_cores(processes: int) -> None:
    """Limits the threads of this process, but for what the user has set; for a program, not for a library."""
    wanted = thread_variables(processes)
    is_chosen = "OPENCV_FOR_THREADS_NUM" in os.environ
    for name, value in wanted.items():
        os.environ.setdefault(name, value)
    if "cv2" in sys.modules and not is_chosen:  # it reads its variable when it is imported
        sys.modules["cv2"].setNumThreads(int(wanted[CORES]))
