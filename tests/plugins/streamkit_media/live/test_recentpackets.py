"""Transport packets from which a sender that begins anew is read again."""

from pathlib import Path

import av
import pytest

from streamkit_media.live.recentpackets import MAX_BYTES, RecentPackets, pes_time
from streamkit_media.udp import PACKET_BYTES

DATAGRAM = 7 * PACKET_BYTES


@pytest.fixture(scope="module")
def stream(clip: Path) -> bytes:
    """A transport stream."""
    return clip.read_bytes()


def first_frame(clip: Path) -> tuple[int, int]:
    """The packet identifier of the video and the decoding time of its first frame."""
    with av.open(str(clip)) as container:
        video = container.streams.video[0]
        packet = next(container.demux(video))
        assert packet.dts is not None
        return video.id, packet.dts


@pytest.mark.parametrize("cut", [0, 5, 187])
def test_a_stream_is_found_from_its_first_table(clip: Path, stream: bytes, cut: int) -> None:
    """Behind the rest of another, which may begin within a packet; all that has come after it is there."""
    old, new = stream[: 20 * DATAGRAM], stream[: 30 * DATAGRAM]
    recent = RecentPackets()
    recent.add(old[10 * DATAGRAM + cut :].replace(b"\0\0\1\xe0", b"\0\0\2\xe0"))
    for start in range(0, len(new), DATAGRAM):
        recent.add(new[start : start + DATAGRAM])
    found = recent.since(*first_frame(clip))
    assert new.endswith(found)
    assert 0 <= len(new) - len(found) < 4 * PACKET_BYTES  # the service description, before the table


def test_a_frame_that_has_gone_is_not_found(clip: Path, stream: bytes) -> None:
    """Two frames later nothing of it is kept; without its table, or in damaged packets, it is no use."""
    pid, time = first_frame(clip)
    recent = RecentPackets()
    recent.add(stream)
    assert recent.since(pid, time + 1) == b""
    recent.end_frame()
    assert recent.since(pid, time)
    recent.add(b"")
    recent.end_frame()
    recent.add(b"")
    recent.end_frame()
    assert recent.since(pid, time) == b""
    damaged = RecentPackets()
    damaged.add(stream[: 3 * DATAGRAM] + b"?" + stream[3 * DATAGRAM :])
    assert damaged.since(pid, time + 10**6) == b""


def test_what_is_kept_is_bounded() -> None:
    """A stream without frames does not fill the memory."""
    recent = RecentPackets()
    for _ in range(3 * MAX_BYTES // (1 << 20)):
        recent.add(bytes(1 << 20))
    assert sum(map(len, recent._parts)) == MAX_BYTES


@pytest.mark.parametrize("packet", [b"\x47\x40\x11\x10" + bytes(184), b"\x47\x40\x11\x30\xff" + bytes(183)])
def test_a_packet_without_a_frames_start_has_no_time(packet: bytes) -> None:
    """Also where the field before the payload claims more bytes than there are."""
    assert pes_time(packet) is None
