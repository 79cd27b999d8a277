"""The pipeline of a file or camera: what it prints while it starts, and why it failed."""

import sys
from collections.abc import Callable
from typing import Any

import pytest

from streamkit_view.playback import Playback

SCRIPT = """
import sys, time
print("warning: ground: loops are being compiled", file=sys.stderr, flush=True)
sys.stdin.close()
time.sleep({seconds})
sys.exit("error: rtsp://user:secret@drone/live cannot be opened")
"""


def playback(seconds: float) -> Playback:
    """A pipeline that compiles, and fails after a time."""
    script = SCRIPT.format(seconds=seconds)
    return Playback("rtsp://user:secret@drone/live", "view/1", (sys.executable, "-c", script))


def test_the_element_that_compiles_is_named(
    wait_for: Callable[..., Any], capfd: pytest.CaptureFixture[str]
) -> None:
    """To the page, and in the terminal; the end of the playback ends the process."""
    found = playback(600)
    assert found.progress == "The pipeline is starting."
    try:
        found.start()
        wait_for(lambda: found.progress == "The pipeline is starting. ground: loops are being compiled")
        assert found.failure == ""
    finally:
        found.close()
    assert "warning: ground: loops are being compiled" in capfd.readouterr().err


def test_a_failure_is_its_last_line_without_secrets(wait_for: Callable[..., Any]) -> None:
    """The password of the camera is masked."""
    found = playback(0)
    try:
        found.start()
        wait_for(lambda: "cannot be opened" in found.failure)
        assert "secret" not in found.failure
    finally:
        found.close()
