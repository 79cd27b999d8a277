"""The bus: order, bounds, and what is never dropped."""

import threading

import pytest

from streamkit.flow.messages import Message, MessageKind
from streamkit.graph.bus import CAPACITY, Bus


def note(number: int) -> Message:
    """An element message."""
    return Message(MessageKind.ELEMENT, "e", str(number))


def test_messages_come_in_order() -> None:
    """First in, first out; None when there is none."""
    bus = Bus()
    for number in range(3):
        bus.post(note(number))
    assert [bus.pop(), bus.pop(), bus.pop(), bus.pop()] == [note(0), note(1), note(2), None]


def test_waiting_for_kinds_discards_the_others() -> None:
    """bus-pop: what is not wanted is gone."""
    bus = Bus()
    bus.post(note(0))
    bus.post(Message(MessageKind.EOS))
    bus.post(note(1))
    found = bus.pop(0.0, (MessageKind.EOS,))
    assert found is not None
    assert found.kind is MessageKind.EOS
    assert bus.pop() == note(1)


def test_waiting_ends_with_the_time() -> None:
    """None, and not for ever."""
    assert Bus().pop(0.01) is None


def test_a_message_wakes_a_waiting_pop() -> None:
    """From another thread, with and without a timeout."""
    bus = Bus()
    for timeout_s in (10.0, None):
        poster = threading.Thread(target=bus.post, args=(note(7),))
        poster.start()
        assert bus.pop(timeout_s) == note(7)
        poster.join(10)


def test_a_full_bus_drops_the_oldest_but_no_error_or_eos() -> None:
    """Drops are counted; the order of the rest is kept."""
    bus = Bus()
    bus.post(Message(MessageKind.ERROR, "x"))
    bus.post(Message(MessageKind.EOS))
    for number in range(CAPACITY + 3):
        bus.post(note(number))
    assert bus.lost == 5
    kinds = [message.kind for message in iter(bus.pop, None)]
    assert kinds[:2] == [MessageKind.ERROR, MessageKind.EOS]
    assert len(kinds) == CAPACITY


def test_a_bus_full_of_errors_still_takes_messages() -> None:
    """Posting never blocks a streaming thread."""
    bus = Bus()
    for number in range(CAPACITY + 2):
        bus.post(Message(MessageKind.ERROR, "x", str(number)))
    assert bus.lost == 2
    first = bus.pop()
    assert first is not None
    assert first.text == "2"


def test_watchers_see_messages_at_once() -> None:
    """bus-sync: in the posting thread, before the message is in the line; all of them see it."""
    bus = Bus()
    seen: list[tuple[int, str]] = []
    bus.watch(lambda message: seen.append((threading.get_ident(), message.text)))
    bus.watch(lambda message: seen.append((threading.get_ident(), message.text)))
    bus.post(note(4))
    assert seen == [(threading.get_ident(), "4")] * 2
    assert bus.pop() == note(4)


@pytest.mark.parametrize("kind", list(MessageKind))
def test_a_watcher_that_raises_changes_nothing(kind: MessageKind, caplog: pytest.LogCaptureFixture) -> None:
    """Least of all hides an error, without which the pipeline would never end; it is logged once."""
    bus = Bus()
    seen: list[Message] = []

    def fail(message: Message) -> None:
        raise ValueError("in watch")

    bus.watch(fail)
    bus.watch(seen.append)
    messages = [Message(kind, "x", "1"), Message(kind, "x", "2")]
    for message in messages:
        bus.post(message)
    assert seen == [bus.pop(), bus.pop()] == messages
    (record,) = caplog.records
    assert "function given to bus.watch has raised" in record.message
    assert "in watch" in caplog.text


def test_flush_discards_unread_messages() -> None:
    """bus-null: of an earlier run."""
    bus = Bus()
    bus.post(note(1))
    bus.flush()
    assert bus.pop() is None
