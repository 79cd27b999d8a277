"""`streamkit launch` with bins in processes: one Ctrl-C ends all, and with -e files are completed."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

LIMIT_S = 80.0
STREAMKIT = str(Path(sys.executable).with_name("streamkit"))


def descendants(parent: int) -> list[int]:
    """The children of a process that run bins."""
    found = []
    for entry in filter(str.isdigit, os.listdir("/proc")):
        try:
            is_child = int(Path(f"/proc/{entry}/stat").read_text().rpartition(")")[2].split()[1]) == parent
            if is_child and "processes.child" in Path(f"/proc/{entry}/cmdline").read_text():
                found.append(int(entry))
        except OSError:
            continue
    return found


@pytest.mark.parametrize("options", [(), ("-e",)])
def test_one_interrupt_ends_all(options: tuple[str, ...], tmp_path: Path) -> None:
    """Exit code 0, no process left, and a file that is whole with -e."""
    out = tmp_path / "out.txt"
    text = (
        "( process=true fakesrc is-live=true ) ! ( process=true identity ! tee name=t ! queue ! fakesink ) "
        f"t. ! queue ! filesink location={out} t. ! queue ! identity silent=false ! fakesink"
    )
    with subprocess.Popen(
        [STREAMKIT, "launch", "-v", *options, text], stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as child:
        assert child.stderr is not None
        for line in child.stderr:
            if "playing" in line:
                break
        members = descendants(child.pid)
        assert len(members) == 2
        time.sleep(0.5)  # so that frames flow; nothing depends on how many
        os.killpg(child.pid, signal.SIGINT)
        errors = child.stderr.read()
        assert child.wait(LIMIT_S) == 0, errors
    assert "error" not in errors
    assert not [pid for pid in members if Path(f"/proc/{pid}").exists()]
    assert out.exists() or not options


def test_a_death_is_an_error_of_the_command() -> None:
    """Exit code 1 and a line that names the element."""
    done = subprocess.run(
        [STREAMKIT, "launch", "fakesrc num-buffers=100 ! ( process=true doomed how=exit at=9 ) ! fakesink"],
        capture_output=True, text=True, timeout=LIMIT_S, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert done.returncode == 1
    assert "error: doomed0: the process of bin0 has ended with code 7 [at frame seq=9]" in done.stderr


def test_a_death_at_the_stop_is_a_warning() -> None:
    """Everything has been delivered, but a file of the process may not be whole."""
    done = subprocess.run(
        [STREAMKIT, "launch", "fakesrc num-buffers=3 ! ( process=true doomed how=abort at=-3 ) ! fakesink"],
        capture_output=True, text=True, timeout=LIMIT_S, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    warning = "warning: doomed0: at the stop: doomed0: the process of bin0 was ended by signal 6 (SIGABRT)"
    assert warning in done.stderr


def test_an_exception_of_an_element_is_told_with_its_place() -> None:
    """File and line as in one process, and with -v the traceback."""
    done = subprocess.run(
        [STREAMKIT, "launch", "-v", "fakesrc ! ( process=true doomed how=raise at=3 ) ! fakesink"],
        capture_output=True, text=True, timeout=LIMIT_S, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert done.returncode == 1
    error = r"error: doomed0: ValueError: as the test wants \[at frame seq=3.*\] \(\w+\.py:\d+\)$"
    assert re.search(error, done.stderr, re.MULTILINE), done.stderr
    assert 'raise ValueError("as the test wants")' in done.stderr
