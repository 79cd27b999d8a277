import time
from collections.abc import Callable

import pytest

from streamkit import ResourceError
from streamkit.flow.clock import SystemClock
from streamkit.handoff.bounded_queue import BoundedQueue
from streamkit_media.failures import silence
from streamkit_media.live.connection import LiveConnection, QueuedPacket
from streamkit_media.live.timeline import PacketStamps
from streamkit_media.rtsp.rtspinput import RtspInput
from streamkit_media.streams import StreamKind

MARGIN_S = 5.0  # for a machine under load; benchmarks/rtsp_faults.py measures how soon faults are noticed


def reader_of(location: str, timeout_s: float) -> tuple[LiveConnection, BoundedQueue[QueuedPacket]]:
    """A connection over TCP and its queue."""
    source = RtspInput(location, {"rtsp_transport": "tcp"}, timeout_s)
    kinds = frozenset({StreamKind.VIDEO})
    connection = LiveConnection(source, kinds, 8, 100, PacketStamps(SystemClock()), lambda *_: None)
    return connection, connection.queue


@pytest.mark.parametrize("answers", [0, 1])
@pytest.mark.parametrize("after_s", [0.0, 0.2])
def test_reading_ends_at_any_moment(serve: Callable[[int], int], answers: int, after_s: float) -> None:
    """A reader that waits for a silent server ends at once when `end` is called."""
    reader, ring = reader_of(f"rtsp://127.0.0.1:{serve(answers)}/live", 60)
    reader.begin()
    assert ring.get(after_s) is None
    began = time.monotonic()
    assert reader.end(limit_s=5)
    assert time.monotonic() - began < 0.5 + MARGIN_S
    assert ring.is_over


@pytest.mark.parametrize("answers", [0, 1])
def test_silence_is_noticed_in_time(serve: Callable[[int], int], answers: int) -> None:
    """A server that says nothing, or nothing more, gives one error soon after the limit."""
    reader, ring = reader_of(f"rtsp://me:secret@127.0.0.1:{serve(answers)}/live", 0.5)
    began = time.monotonic()
    reader.begin()
    with pytest.raises(
        ResourceError, match=r"^rtsp://\*\*\*@127\.0\.0\.1:\d+/live: no video within 0\.5 s: "
    ):
        ring.get(10)
    assert time.monotonic() - began < 0.5 + MARGIN_S
    assert reader.end(1)


def test_a_closed_port_is_reported() -> None:
    """A refused connection gives the reason at once."""
    reader, ring = reader_of("rtsp://127.0.0.1:1/live", 5)
    reader.begin()
    with pytest.raises(ResourceError, match=r"no connection to 127\.0\.0\.1 port 1: Connection refused"):
        ring.get(5)
    assert reader.end(1)


def test_silence_names_the_server_without_password() -> None:
    """The error names address, limit and remedy."""
    assert str(silence("rtsp://u:p@cam/live", 5)) == (
        "rtsp://***@cam/live: the server has been silent for 5 s (timeout-s); check that it plays elsewhere, "
        "or allow more time"
    )
