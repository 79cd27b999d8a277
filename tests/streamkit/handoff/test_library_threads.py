"""The threads of libraries follow the number of processes that share the cores."""

import os
import subprocess
import sys

import pytest

from streamkit.handoff.library_threads import CORES, available_cores, thread_variables


def test_cores_are_shared(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each process has its part, at least one core; linear algebra has one thread."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)))
    assert thread_variables(3)["OPENCV_FOR_THREADS_NUM"] == "2"
    assert thread_variables(20)["OPENCV_FOR_THREADS_NUM"] == "1"
    assert thread_variables(3)["OPENBLAS_NUM_THREADS"] == "1"


@pytest.mark.parametrize(("share", "cores"), [("3", 3), ("", 8), ("0", 8), ("many", 8), ("99", 8)])
def test_the_share_of_a_process(monkeypatch: pytest.MonkeyPatch, share: str, cores: int) -> None:
    """Never more cores than there are; what is no number has no effect."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)))
    monkeypatch.setenv(CORES, share)
    assert available_cores() == cores


@pytest.mark.parametrize(("imported", "own", "threads"), [(True, "", 1), (False, "", 1), (True, "2", 2)])
def test_opencv_follows(imported: bool, own: str, threads: int) -> None:
    """Imported before or after, unless the user has set a number."""
    code = (
        f"import sys\nfrom streamkit.handoff.library_threads import share_cores\n"
        f"if {imported}:\n    import cv2\nshare_cores(1000)\nimport cv2\nprint(cv2.getNumThreads())\n"
    )
    variables = {name: value for name, value in os.environ.items() if "THREADS" not in name}
    if own:
        variables["OPENCV_FOR_THREADS_NUM"] = own
    done = subprocess.run(
        [sys.executable, "-c", code], env=variables, capture_output=True, text=True, timeout=60, check=True
    )
    assert int(done.stdout) == threads
