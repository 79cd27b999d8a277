"""A process with zenoh ends within three seconds and with the right exit code, however it ends."""

from __future__ import annotations

import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from streamkit_zenoh.configuration import SessionMode, SessionSettings
from streamkit_zenoh.session import close_session, open_session
from streamkit_zenoh.subscriber import TrackSubscriber
from tests.acceptance.zenoh_links import BINARY, Router, router
from tests.ports import free_port
from tests.slowness import patience
from tests.waiting import wait_for

KEY = "acceptance/endings"
LIMIT_S = 3.0


@pytest.fixture
def meeting() -> Iterator[Router]:
    """A router."""
    with router(f"tcp/127.0.0.1:{free_port()}") as running:
        yield running


def _launch(text: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [str(BINARY), "launch", text], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def _publishing(meeting: Router) -> subprocess.Popen[str]:
    """A pipeline that publishes; a subscriber has received a record when this returns."""
    text = "videotestsrc ! video/x-raw, framerate=50/1 ! zenohsink sync=true"
    process = _launch(f"{text} key={KEY} mode=client connect={meeting.endpoint}")
    with TrackSubscriber(KEY, connect=meeting.endpoint, mode="client") as subscriber:
        if subscriber.get(30) is None:
            process.kill()
            pytest.fail(f"no record has come: {process.communicate(timeout=10)}")
    return process


def _end(process: subprocess.Popen[str], number: int) -> tuple[int, str, float]:
    """Exit code, stderr and the time it took to end."""
    process.send_signal(number)
    began_s = time.monotonic()
    try:
        _, err = process.communicate(timeout=patience(20))
    finally:
        process.kill()
        process.wait(10)
    return process.returncode, err, time.monotonic() - began_s


def unexpected_lines(err: str) -> list[str]:
    """The output without the lines about the interrupt, the run, and tracks, which a test frame lacks."""
    lines = [line for line in err.splitlines() if line and not line.startswith("interrupt:")]
    return [line for line in lines if "carried tracks" not in line and " frames in " not in line]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_the_publisher(meeting: Router, number: int) -> None:
    """Exit code 0, no output, no thread left."""
    code, err, took_s = _end(_publishing(meeting), number)
    assert code == 0, err
    assert not unexpected_lines(err)
    assert took_s < patience(LIMIT_S)


def test_a_lost_router_does_not_delay_the_end(meeting: Router) -> None:
    """The process ends as quickly without link; the pipeline continues without its router."""
    process = _publishing(meeting)
    meeting.kill()
    assert process.poll() is None
    code, err, took_s = _end(process, signal.SIGINT)
    assert code == 0, err
    assert not unexpected_lines(err)
    assert took_s < patience(LIMIT_S)


def test_a_source_without_router_ends_too(meeting: Router) -> None:
    """A signal ends a source that waits for publishers, with or without router."""
    session = open_session(SessionSettings(mode=SessionMode.CLIENT, connect=meeting.endpoint))
    process = _launch(f"zenohsrc key={KEY} mode=client connect={meeting.endpoint} ! fakesink")
    try:
        publisher = session.declare_publisher(f"{KEY}/tracks")
        assert wait_for(lambda: bool(getattr(publisher.matching_status, "matching", False)), 30)
    finally:
        close_session(session, 5.0)
    meeting.kill()
    code, err, took_s = _end(process, signal.SIGTERM)
    assert code == 0, err
    assert not unexpected_lines(err)
    assert took_s < patience(LIMIT_S)


def test_a_full_disk_ends_the_pipeline(meeting: Router, tmp_path: Path) -> None:
    """The error names the file, with a remedy; exit code 1 while records still arrive."""
    location = tmp_path / "tracks.jsonl"
    location.symlink_to("/dev/full")
    source = f"zenohsrc key={KEY} mode=client connect={meeting.endpoint}"
    process = _launch(f"{source} ! tracksink location={location}")
    session = open_session(SessionSettings(mode=SessionMode.CLIENT, connect=meeting.endpoint))
    try:
        publisher = session.declare_publisher(
            f"{KEY}/tracks", congestion_control=zenoh.CongestionControl.BLOCK
        )
        assert wait_for(lambda: bool(getattr(publisher.matching_status, "matching", False)), 30)
        record = b'{"schema":"streamkit.tracks/1","source":"x","seq":1,"epoch":0,"tracks":[],"dropped":0}'
        began_s = time.monotonic()
        while process.poll() is None and time.monotonic() - began_s < 20:
            publisher.put(record)
        took_s = time.monotonic() - began_s
        _, err = process.communicate(timeout=10)
    finally:
        process.kill()
        process.wait(10)
        close_session(session, 5.0)
    assert process.returncode == 1
    assert str(location) in err
    assert "No space left on device; free some space" in err
    assert took_s < patience(LIMIT_S)
