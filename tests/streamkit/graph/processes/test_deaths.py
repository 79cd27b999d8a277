"""What happens when a child or the parent dies: an error that says so, and nothing left behind."""

import gc
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from streamkit import ElementFailure
from streamkit.errors import ProcessDied
from streamkit.graph.pipeline import Pipeline

SOON_S = 20.0
LIMIT_S = 80.0  # a busy machine takes long to start a process
DEATHS = {
    "segfault": r"was ended by signal 11 \(SIGSEGV\)",
    "kill": r"was ended by signal 9 \(SIGKILL\)",
    "abort": r"was ended by signal 6 \(SIGABRT\)",
    "exit": "has ended with code 7",
}


def descriptors() -> list[str]:
    """What this process has open."""
    found = []
    for entry in os.listdir("/proc/self/fd"):
        try:
            found.append(os.readlink(f"/proc/self/fd/{entry}"))
        except OSError:
            continue
    return sorted(re.sub(r"\d+", "", name) for name in found)


def children(parent: int) -> list[int]:
    """The processes whose parent is a given one, zombies included."""
    found = []
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            try:
                fields = Path(f"/proc/{entry}/stat").read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if int(fields[1]) == parent:
                found.append(int(entry))
    return found


def assert_nothing_left(before: tuple[list[str], list[str], list[int]]) -> None:
    """Shared memory, descriptors, children and threads are soon those of before."""
    deadline = time.monotonic() + SOON_S
    while state() != before and time.monotonic() < deadline:
        time.sleep(0.05)
    assert state() == before
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("streamkit")]


def state() -> tuple[list[str], list[str], list[int]]:
    """What may be left behind."""
    gc.collect()
    return shared_memory(), descriptors(), children(os.getpid())


def shared_memory() -> list[str]:
    """Shared memory with a name, but for that of browsers in other tests."""
    return sorted(name for name in os.listdir("/dev/shm") if name.startswith(("psm_", "sem.", "streamkit")))


@pytest.mark.parametrize("how", DEATHS)
@pytest.mark.parametrize("place", ["( process=true {} ) ! fakesink", "( process=true {} ! fakesink )"])
def test_the_death_of_a_child_is_told(how: str, place: str) -> None:
    """The error names the signal, the element at work and its frame; nothing is left behind."""
    before = state()
    text = "fakesrc num-buffers=200 sizetype=fixed ! " + place.format(f"doomed name=d how={how} at=50")
    with Pipeline.parse(text) as pipeline:
        with pytest.raises(ElementFailure, match=DEATHS[how]) as error:
            pipeline.run(LIMIT_S)
        assert isinstance(error.value.cause, ProcessDied)
        assert error.value.element == "d"
        assert error.value.frame.startswith("frame seq=50")
    assert_nothing_left(before)


@pytest.mark.parametrize("how", ["sleep", "hold", "stop"])
def test_a_child_that_hangs_is_told(how: str) -> None:
    """A hang beyond `watchdog-s` is an error, also if no Python code runs in the child."""
    before = state()
    text = f"fakesrc num-buffers=200 ! ( process=true watchdog-s=1 doomed name=d how={how} at=50 ) ! fakesink"
    with Pipeline.parse(text) as pipeline:
        with pytest.raises(ElementFailure, match="has not") as error:
            pipeline.run(LIMIT_S)
        assert error.value.element == "d"
        assert error.value.frame.startswith("frame seq=50")
    assert_nothing_left(before)


def test_a_child_that_cannot_start_is_told() -> None:
    """The start fails with the error of the element, and the other children end."""
    before = state()
    text = "( process=true filesrc name=f location=/nowhere ! decode ) ! ( process=true identity ) ! fakesink"
    with Pipeline.parse(text) as pipeline, pytest.raises(ElementFailure, match=r"^f .*/nowhere"):
        pipeline.play()
    assert_nothing_left(before)


SCRIPT = """
import sys
from streamkit.graph.pipeline import Pipeline
pipeline = Pipeline.parse(
    "fakesrc is-live=true ! ( process=true identity name=a ) ! ( process=true identity name=b ) ! fakesink"
)
pipeline.play()
print("plays", flush=True)
pipeline.wait()
"""


def test_children_end_with_a_killed_parent() -> None:
    """No orphan and no shared memory is left when the parent is killed."""
    shared = shared_memory()
    with subprocess.Popen([sys.executable, "-c", SCRIPT], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == "plays\n"
        orphans = children(parent.pid)
        assert len(orphans) == 2
        parent.kill()
    deadline = time.monotonic() + LIMIT_S
    while any(is_running(pid) for pid in orphans):
        assert time.monotonic() < deadline, "a child outlives its parent"
        time.sleep(0.05)
    assert shared_memory() == shared


def is_running(pid: int) -> bool:
    """Whether a process is there and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
