import msgspec
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from streamkit_media.rtsp.pusher import (
    PushMessage,
    PushPacket,
    message,
    take_messages,
)

TIMES = st.integers(-(2**63), 2**63 - 1)


@settings(deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(st.builds(PushPacket, TIMES, TIMES, TIMES, st.booleans(), st.binary(max_size=100)))
def test_packets_come_out_as_they_went_in(packet: PushPacket) -> None:
    """Times, flag and data of any packet survive the pipe."""
    ((kind, content),) = take_messages(bytearray(message(PushMessage.PACKET, packet)))
    assert (kind, msgspec.msgpack.decode(content, type=PushPacket)) == (PushMessage.PACKET, packet)


@settings(deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.lists(st.tuples(st.sampled_from(PushMessage), st.binary(max_size=20)), max_size=8),
    st.lists(st.integers(1, 9), min_size=1),
)
def test_messages_in_pieces_are_joined(sent: list[tuple[PushMessage, bytes]], sizes: list[int]) -> None:
    """However the pipe cuts what goes through it, the same messages come out, and nothing is left."""
    stream = b"".join(message(kind, content) for kind, content in sent)
    received, found, at = bytearray(), [], 0
    while at < len(stream):
        size = sizes[at % len(sizes)]
        received += stream[at : at + size]
        found += take_messages(received)
        at += size
    assert [(kind, msgspec.msgpack.decode(content)) for kind, content in found] == sent
    assert not received
