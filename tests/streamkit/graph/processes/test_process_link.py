"""ProcessLink: what the reading half makes of a writing process that is started again."""

import os
import queue
import threading

from streamkit import Caps, Frame
from streamkit.crossing.channel import Channel
from streamkit.crossing.shared_memory import make_numbers
from streamkit.flow.events import EOS
from streamkit.graph.processes.process_link import ProcessLink

LIMIT_S = 20.0


def writer_to(reader: ProcessLink) -> ProcessLink:
    """A writing half, connected to a reading one in this process."""
    writer = ProcessLink("writer")
    writer.writes = True
    counts, descriptor = make_numbers(2)
    os.close(descriptor)
    for link, end in zip((reader, writer), Channel.pair(), strict=True):
        link.connect(end, counts)
    return writer


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
