"""ProcessLink: what the reading half makes of a writing process that is started again."""

import os
import queue
import threading
from collections.abc import Callable
from typing import Any, cast

import numpy as np
import pytest

from streamkit import Caps, Frame
from streamkit.crossing.channel import Channel
from streamkit.crossing.shared_memory import make_numbers
from streamkit.flow.events import EOS, FLUSH_START, FLUSH_STOP, EndOfStream, Flushing, GapEvent
from streamkit.graph.processes.link_writer import COUNTS, WAITING, LinkWriter
from streamkit.graph.processes.process_link import ProcessLink

LIMIT_S = 20.0


def writer_to(reader: ProcessLink) -> ProcessLink:
    """A writing half, connected to a reading one in this process."""
    writer = ProcessLink("writer")
    writer.writes = True
    connect(writer, reader)
    return writer


def connect(*links: ProcessLink) -> None:
    """Gives a new connection to two links."""
    counts, descriptor = make_numbers(COUNTS)
    os.close(descriptor)
    for link, end in zip(links, Channel.pair(), strict=True):
        link.connect(end, counts)


def test_an_epoch_after_a_restart_is_higher_than_all_before() -> None:
    """Also where the frames of several sources came through the link, each with its own epoch."""
    reader = ProcessLink("reader")
    reader.reads = True
    received: queue.Queue[Frame] = queue.Queue()
    reader.pads["src"].push = received.put
    thread = threading.Thread(target=reader.stream)
    thread.start()
    found = []
    for epochs in ((3, 1), (0,)):
        writer = writer_to(reader)
        put = writer.receiver(writer.pads["sink"])
        for epoch in epochs:
            put(Frame(b"", Caps("a/b"), epoch=epoch))
            found.append(received.get(timeout=LIMIT_S).epoch)
        if len(found) == 3:
            writer.receive_event(writer.pads["sink"], EOS)
            thread.join(LIMIT_S)
        writer.disconnect()
    assert found == [3, 1, 4]
    assert not thread.is_alive()
    reader.disconnect()


def test_a_reader_that_connects_while_eos_is_sent_gets_it_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """The reader before it may have died without reading it."""
    readers = [ProcessLink("old"), ProcessLink("new")]
    writer = writer_to(readers[0])
    send = Channel.send
    readers[1].reads = True

    def send_and_connect(channel: Channel, *arguments: Any) -> bool:
        monkeypatch.setattr(Channel, "send", send)
        is_sent = channel.send(*arguments)
        connect(writer, readers[1])
        return is_sent

    monkeypatch.setattr(Channel, "send", send_and_connect)
    writer.receive_event(writer.pads["sink"], EOS)
    thread = threading.Thread(target=readers[1].stream)
    thread.start()
    thread.join(LIMIT_S)
    assert readers[1].pads["src"].is_eos
    for link in (writer, *readers):
        link.disconnect()


def test_a_writer_may_be_started_again_twice_while_a_frame_is_taken() -> None:
    """As while the process downstream is started again: what the first one has sent since is lost."""
    reader = ProcessLink("reader")
    reader.reads = True
    is_taken, may_go_on = threading.Event(), threading.Event()
    received: list[int] = []

    def push(frame: Frame) -> None:
        received.append(frame.seq)
        is_taken.set()
        assert may_go_on.wait(LIMIT_S)

    reader.pads["src"].push = push
    writers = [writer_to(reader)]
    put = writers[0].receiver(writers[0].pads["sink"])
    for seq in range(2):  # each needs a slot of its own, with its descriptor
        put(Frame(np.zeros(1000 * (seq + 1), np.uint8), Caps("a/b"), seq=seq))
    thread = threading.Thread(target=reader.stream)
    thread.start()
    assert is_taken.wait(LIMIT_S)
    writers += [writer_to(reader) for _ in range(2)]
    may_go_on.set()
    writers[2].receiver(writers[2].pads["sink"])(Frame(np.zeros(1000, np.uint8), Caps("a/b"), seq=7))
    writers[2].receive_event(writers[2].pads["sink"], EOS)
    thread.join(LIMIT_S)
    assert received == [0, 7]
    assert reader.pads["src"].is_eos
    for link in (*writers, reader):
        link.disconnect()


def test_no_frame_is_sent_once_the_reader_wants_no_more() -> None:
    """The writer learns it before the next frame, which is then neither sent nor counted as lost."""
    reader = ProcessLink("reader")
    reader.reads = True

    def refuse(frame: Frame) -> None:
        raise EndOfStream("sink")

    reader.pads["src"].push = refuse
    writer = writer_to(reader)
    put = writer.receiver(writer.pads["sink"])
    thread = threading.Thread(target=reader.stream)
    thread.start()
    put(Frame(b"", Caps("a/b"), seq=0))
    thread.join(LIMIT_S)
    counts = writer.connection().counts
    with pytest.raises(EndOfStream):
        put(Frame(b"", Caps("a/b"), seq=1))
    assert counts[:5].tolist() == [1, 1, 0, 1, 0]
    for link in (writer, reader):
        link.disconnect()


def test_a_writer_that_waits_for_room_is_woken(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a message of the reader, not by the end of a time limit."""
    reader = ProcessLink("reader")
    reader.reads = True
    received: queue.Queue[Frame] = queue.Queue()
    reader.pads["src"].push = received.put
    writer = writer_to(reader)
    writer.capacity = 1
    messages: list[bytes] = []
    receive = writer.receive

    def receive_and_keep(channel: Channel) -> list[bytes]:
        found = receive(channel)
        messages.extend(found)
        return found

    monkeypatch.setattr(writer, "receive", receive_and_keep)
    thread = threading.Thread(target=reader.stream)
    put = writer.receiver(writer.pads["sink"])
    blocked = threading.Thread(target=lambda: [put(Frame(b"", Caps("a/b"), seq=seq)) for seq in range(100)])
    blocked.start()
    counts = writer.connection().counts
    while not counts[WAITING]:  # the second frame has no room until the reader runs
        assert blocked.is_alive()
    thread.start()
    blocked.join(LIMIT_S)
    assert [received.get(timeout=LIMIT_S).seq for _ in range(100)] == list(range(100))
    assert messages
    writer.receive_event(writer.pads["sink"], EOS)
    thread.join(LIMIT_S)
    for link in (writer, reader):
        link.disconnect()


def test_a_frame_that_meets_a_flush_is_counted() -> None:
    """The writer's thread may send it between the begin and the end of the flush; those that follow pass."""
    reader = ProcessLink("reader")
    reader.reads = True
    received: queue.Queue[Frame] = queue.Queue()

    def push(frame: Frame) -> None:
        if frame.seq == 0:
            raise Flushing("downstream")
        received.put(frame)

    reader.pads["src"].push = push
    writer = writer_to(reader)
    thread = threading.Thread(target=reader.stream)
    thread.start()
    put = writer.receiver(writer.pads["sink"])
    for seq in range(2):
        put(Frame(b"", Caps("a/b"), seq=seq))
    assert received.get(timeout=LIMIT_S).seq == 1
    assert reader.drops == {"flushed": 1}
    writer.receive_event(writer.pads["sink"], EOS)
    thread.join(LIMIT_S)
    for link in (writer, reader):
        link.disconnect()


def test_a_frame_on_its_way_into_a_link_is_dropped_by_a_flush(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where there was room for it before the flush began, and the flush is over since."""
    reader = ProcessLink("reader")
    writer = writer_to(reader)
    wait_for_room = LinkWriter._wait_for_room

    def wait_and_flush(*arguments: Any) -> None:
        wait_for_room(*arguments)
        writer.flush(begins=True)
        writer.flush(begins=False)

    monkeypatch.setattr(LinkWriter, "_wait_for_room", wait_and_flush)
    with pytest.raises(Flushing):
        writer.receiver(writer.pads["sink"])(Frame(b"", Caps("a/b")))
    writer.disconnect()
    reader.disconnect()


def test_a_reader_that_connects_after_a_flush_gets_the_eos_from_before_it() -> None:
    """The threads upstream are over; the flush drops frames only."""
    first, second = ProcessLink("first"), ProcessLink("second")
    writer = writer_to(first)
    for event in (EOS, FLUSH_START, FLUSH_STOP):
        writer.pads["sink"].receive_event(event)
    connect(writer, second)
    second.reads = True
    thread = threading.Thread(target=second.stream)
    thread.start()
    thread.join(LIMIT_S)
    assert second.pads["src"].is_eos
    for link in (writer, first, second):
        link.disconnect()


def test_a_flush_needs_no_reader() -> None:
    """As while its process is started again: nothing is on the way to it."""
    writer = ProcessLink("writer")
    writer.writes = True
    for event in (FLUSH_START, FLUSH_STOP):
        writer.pads["sink"].receive_event(event)
    assert not writer.is_flushing


class Hooked:
    """A condition that calls a function, once, as its lock is released."""

    def __init__(self, condition: threading.Condition, released: Callable[[], None]) -> None:
        self._condition = condition
        self._hooks = [released]

    def __enter__(self) -> None:
        self._condition.__enter__()

    def __exit__(self, *error: object) -> None:
        self._condition.__exit__(None, None, None)
        while self._hooks:
            self._hooks.pop()()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._condition, name)


def test_an_event_of_another_thread_may_use_a_new_connection_first() -> None:
    """As a flush does: the thread that sends frames has the old one in hand, and leaves the new one open."""
    readers = [ProcessLink("old"), ProcessLink("new")]
    received: queue.Queue[Frame] = queue.Queue()
    for reader in readers:
        reader.reads = True
        reader.pads["src"].push = received.put
    writer = writer_to(readers[0])
    threads = [threading.Thread(target=reader.stream) for reader in readers]
    for thread in threads:
        thread.start()
    put = writer.receiver(writer.pads["sink"])
    put(Frame(b"", Caps("a/b"), seq=0))
    assert received.get(timeout=LIMIT_S).seq == 0

    def connect_and_use() -> None:
        connect(writer, readers[1])
        writer.receive_event(writer.pads["sink"], GapEvent(0))

    writer.changed = cast("threading.Condition", Hooked(writer.changed, connect_and_use))
    put(Frame(b"", Caps("a/b"), seq=1))
    assert received.get(timeout=LIMIT_S).seq == 1
    writer.receive_event(writer.pads["sink"], EOS)
    readers[0].give_up()
    for thread in threads:
        thread.join(LIMIT_S)
    for link in (writer, *readers):
        link.disconnect()
