"""A program that leaves its pipeline without `stop` ends all the same."""

import subprocess
import sys
from pathlib import Path

import pytest

LIVE = """
from streamkit import Pipeline
pipeline = Pipeline.parse("videotestsrc is-live=true ! appsink name=out")
pipeline.play()
next(iter(pipeline["out"]))
raise KeyError("the program's own error")
"""
ENDED = """
from streamkit import Pipeline
text = "videotestsrc num-buffers=3 ! filesink location={location}"
pipeline = Pipeline.parse(text, watchdog_s={watchdog_s})
pipeline.play()
print(pipeline.wait().kind)
"""
READ = """
import numpy, streamkit
images = (numpy.zeros((48, 64), numpy.uint8) for _ in range(1000))
text = "tee name=t t. ! queue ! filesink location={location} t. ! queue"
video = streamkit.open(images, text, framerate=25)
for frame in video:
    break
print("done")
"""
IN_A_THREAD = """
import threading
from streamkit import Pipeline
pipeline = Pipeline.parse("videotestsrc num-buffers=40 is-live=true ! filesink location={location}")
threading.Thread(target=lambda: print(pipeline.run())).start()
while not pipeline.statistics()[-1].frames_in:  # after the main thread Python 3.12 starts no other
    pass
"""
NO_MORE_THREADS = """
import threading
def refuse(thread):
    raise RuntimeError("can't create new thread at interpreter shutdown")
threading.Thread.start = refuse
"""


def run(script: str) -> subprocess.CompletedProcess[str]:
    """The script in a process of its own, which must end by itself."""
    command = [sys.executable, "-c", script]
    return subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)


def test_an_error_of_the_program_ends_it_and_its_live_pipeline() -> None:
    """The shell gets the prompt back, with the reason."""
    done = run(LIVE)
    assert done.returncode == 1
    assert "the program's own error" in done.stderr
    assert "the program has ended, its pipeline had not" in done.stderr


@pytest.mark.parametrize("then", ["", NO_MORE_THREADS])
@pytest.mark.parametrize("watchdog_s", [30, 0])
def test_a_pipeline_after_eos_does_not_hold_the_program(tmp_path: Path, watchdog_s: int, then: str) -> None:
    """Nothing is said: all was done; Python 3.12 starts no thread after the main one has ended."""
    done = run(ENDED.format(location=tmp_path / "frames.raw", watchdog_s=watchdog_s) + then)
    assert (done.returncode, done.stdout, done.stderr) == (0, "eos\n", "")
    assert (tmp_path / "frames.raw").stat().st_size > 0


@pytest.mark.parametrize("then", ["", NO_MORE_THREADS])
def test_a_pipeline_goes_on_with_the_thread_that_runs_it(tmp_path: Path, then: str) -> None:
    """The main thread may end before it, also where Python then starts no more threads."""
    done = run(IN_A_THREAD.format(location=tmp_path / "frames.raw") + then)
    assert (done.returncode, done.stdout, done.stderr) == (0, "None\n", "")
    assert (tmp_path / "frames.raw").stat().st_size > 0


def test_a_loop_that_is_left_ends_quietly(tmp_path: Path) -> None:
    """Without `with`, and with the reader still at hand; what is written is complete."""
    done = run(READ.format(location=tmp_path / "frames.raw"))
    assert (done.returncode, done.stdout, done.stderr) == (0, "done\n", "")
    assert (tmp_path / "frames.raw").stat().st_size > 0
