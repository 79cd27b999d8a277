"""Channel: messages of any length and descriptors, in order, and the end of the other side."""

import os
import select
import threading

import pytest

from streamkit.crossing.channel import Channel, ChannelClosed


@pytest.fixture
def ends():
    """Two connected channels."""
    ours, theirs = (Channel(end) for end in Channel.pair())
    yield ours, theirs
    ours.close()
    theirs.close()


def receive(channel: Channel, count: int) -> list[bytes]:
    """The next messages."""
    found: list[bytes] = []
    while len(found) < count:
        found += channel.receive()
    return found


def test_messages_arrive_whole_and_in_order(ends: tuple[Channel, Channel]) -> None:
    """From an empty one to one that is larger than the socket's buffer."""
    ours, theirs = ends
    messages = [b"", b"a", bytes(range(256)) * 8000, b"end"]
    sender = threading.Thread(target=lambda: [ours.send(message) for message in messages])
    sender.start()
    assert receive(theirs, len(messages)) == messages
    sender.join()


def test_descriptors_arrive_with_their_messages(ends: tuple[Channel, Channel]) -> None:
    """In order, and open in the receiver although the sender has closed its own."""
    ours, theirs = ends
    for number in range(5):
        reading, writing = os.pipe()
        os.write(writing, bytes([number]))
        ours.send(b"pipe", (reading,))
        os.close(reading)
        os.close(writing)
    assert receive(theirs, 5) == [b"pipe"] * 5
    for number in range(5):
        descriptor = theirs.take_descriptor()
        assert os.read(descriptor, 1) == bytes([number])
        os.close(descriptor)
    with pytest.raises(ValueError, match="has not come"):
        theirs.take_descriptor()


def test_the_end_comes_after_the_last_message(ends: tuple[Channel, Channel]) -> None:
    """What was sent before the end is read; then both directions are closed."""
    ours, theirs = ends
    ours.send(b"last")
    ours.shut_down()
    assert receive(theirs, 1) == [b"last"]
    with pytest.raises(ChannelClosed):
        theirs.receive()
    with pytest.raises(ChannelClosed):
        ours.send(b"more")


def test_a_send_to_a_side_that_does_not_read_can_be_cancelled(ends: tuple[Channel, Channel]) -> None:
    """A whole message is not sent; one that has begun closes the channel."""
    ours, theirs = ends
    assert not ours.send(bytes(10_000_000), (), lambda: True)
    with pytest.raises(ChannelClosed):
        ours.send(b"more")
    del theirs


def test_a_message_that_must_not_wait(ends: tuple[Channel, Channel]) -> None:
    """Not even for another thread, whose message waits for the reader."""
    ours, theirs = ends
    is_cancelled = threading.Event()
    sender = threading.Thread(target=lambda: ours.send(bytes(1 << 22), (), is_cancelled.is_set))
    sender.start()
    assert select.select([theirs._socket], [], [], 5.0)[0]
    assert not ours.send(b"now", (), lambda: True)
    is_cancelled.set()
    sender.join()
