"""Monitor: health, readiness, systemd's notifications."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from streamkit import Message, MessageKind, Pipeline
from streamkit.service.monitor import AGE_BOUNDS_S, Monitor


class Systemd:
    """systemd's end of the socket."""

    def __init__(self, path: Path) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(path))
        self.socket.setblocking(False)
        self.variables = {"NOTIFY_SOCKET": str(path), "WATCHDOG_USEC": "4000000"}

    def heard(self) -> list[str]:
        """What has arrived since the last call."""
        found = []
        while True:
            try:
                found.append(self.socket.recv(100).decode())
            except BlockingIOError:
                return found


@pytest.fixture
def systemd(tmp_path: Path) -> Iterator[Systemd]:
    """A socket that listens."""
    found = Systemd(tmp_path / "notify")
    yield found
    found.socket.close()


def test_systemd_hears_of_the_beginning_the_work_and_the_end(systemd: Systemd) -> None:
    """READY once it plays, WATCHDOG at half of the period that systemd allows, STOPPING at the end."""
    now = [0.0]
    monitor = Monitor(Pipeline.parse("fakesrc ! fakesink"), systemd.variables, lambda: now[0])
    assert systemd.heard() == []
    now[0] = 5.0
    monitor.begin()
    assert systemd.heard() == ["READY=1", "WATCHDOG=1"]
    for now[0] in (5.5, 6.9):
        monitor.beat()
    assert systemd.heard() == []
    now[0] = 7.0
    monitor.beat()
    assert systemd.heard() == ["WATCHDOG=1"]
    monitor.end()
    assert systemd.heard() == ["STOPPING=1"]


def test_without_systemd_nothing_happens(tmp_path: Path) -> None:
    """No socket, or nobody who listens on it, is no error."""
    for variables in ({}, {"NOTIFY_SOCKET": str(tmp_path / "gone")}, {"NOTIFY_SOCKET": "@nobody-listens"}):
        Monitor(Pipeline.parse("fakesrc ! fakesink"), variables).begin()


def test_a_main_loop_that_stands_still_is_unhealthy() -> None:
    """A pipeline that still starts is healthy, one whose loop has not run for over 10 s is not."""
    now = [0.0]
    monitor = Monitor(Pipeline.parse("fakesrc ! fakesink"), {}, lambda: now[0])
    now[0] = 1000.0
    assert monitor.unhealthy_reason() == ""
    monitor.begin()
    now[0] = 1011.0
    assert monitor.unhealthy_reason() == "the main loop has not run for 11 s"
    monitor.beat()
    assert monitor.unhealthy_reason() == ""


def test_ready_is_playing_connected_and_with_frames_at_every_sink() -> None:
    """What is missing is said, the first reason first."""
    with Pipeline.parse("appsrc name=in format=time caps=video/x-raw ! fakesink name=out") as pipeline:
        monitor = Monitor(pipeline, {})
        assert monitor.not_ready_reason() == "the pipeline is null, not playing"
        pipeline.play()
        monitor.begin()
        assert monitor.not_ready_reason() == "no frame has reached out"
        pipeline.bus.post(Message(MessageKind.ELEMENT, "in", "", {"name": "connection", "state": "retrying"}))
        assert monitor.not_ready_reason() == "in is not connected (retrying)"
        assert not monitor.reconnects
        pipeline.bus.post(
            Message(MessageKind.ELEMENT, "in", "", {"name": "connection", "state": "connected"})
        )
        assert monitor.not_ready_reason() == "no frame has reached out"
        assert monitor.reconnects == {"in": 1}
    with Pipeline.parse("fakesrc num-buffers=3 ! fakesink") as pipeline:
        monitor = Monitor(pipeline, {})
        pipeline.play()
        assert pipeline.wait(20) is not None
        assert monitor.not_ready_reason() == ""


def test_a_failed_pipeline_is_unhealthy() -> None:
    """The reason is the failure."""
    with Pipeline.parse("fakesrc num-buffers=3 ! identity error-after=1 ! fakesink") as pipeline:
        monitor = Monitor(pipeline, {})
        pipeline.play()
        pipeline.wait(20)
        assert "identity0" in monitor.unhealthy_reason()
        assert monitor.not_ready_reason() == monitor.unhealthy_reason()


def test_ages_are_sampled_at_sinks() -> None:
    """Each beat counts the age of the newest frame of each sink in its class."""
    with Pipeline.parse("fakesrc num-buffers=3 ! identity ! fakesink name=out") as pipeline:
        monitor = Monitor(pipeline, {})
        pipeline.play()
        pipeline.wait(20)
        monitor.beat()
        assert monitor.ages == {}
        monitor.samples_ages = True
        monitor.beat()
        monitor.beat()
    assert list(monitor.ages) == ["out"]
    assert sum(monitor.ages["out"]) == 2
    assert len(monitor.ages["out"]) == len(AGE_BOUNDS_S) + 1
    assert monitor.age_sums_s["out"] > 0
