"""LinkReader: the half of a process link in the downstream process."""

from __future__ import annotations

import contextlib
import dataclasses
import threading
from typing import TYPE_CHECKING

from streamkit.crossing.channel import ChannelClosed
from streamkit.crossing.stream_codec import StreamDecoder
from streamkit.errors import StreamkitError
from streamkit.flow.events import DiscontinuityEvent, EndOfStream, EosEvent, Event, FlowStop, Flushing
from streamkit.flow.frame import Frame, FrameFlags
from streamkit.graph.processes.link_writer import FLUSHED, REFUSED, TAKEN, WAITING, Connection
from streamkit.handoff.bounded_queue import wait_until

if TYPE_CHECKING:
    from streamkit.graph.processes.process_link import ProcessLink

FLIGHT_LIMIT_S = 2.0  # longest wait of a flush for the frame on its way downstream


class LinkReader:
    """Forwards the frames and events of one run, in a thread of its own, until EOS.

    If the writing process is started again, the frames that follow belong to a new epoch.
    """

    def __init__(self, link: ProcessLink) -> None:
        self._link = link
        self._pad = link.pads["src"]
        self._is_first_of_epoch = False
        self._epoch_offset = self._number_offset = self._highest_epoch = 0
        self._highest_number = -1
        # The thread that has a frame on its way downstream, or 0; guarded by the link's `changed`.
        self._pushing_thread = 0

    def await_push(self) -> None:
        """Waits until the frame that is on its way downstream has met a flush, which has begun there."""
        with self._link.changed:
            own = threading.get_ident()
            wait_until(
                self._link.changed,
                lambda: self._pushing_thread in (0, own),
                FLIGHT_LIMIT_S,
                self._link.stopping,
            )

    def run(self) -> None:
        """Forwards what is received, over one connection after another.

        Raises:
            Flushing: the pipeline stops.
        """
        has_begun = is_over = False
        while not is_over:
            try:
                self._link.wait_while_flushing()
                connection = self._link.connection()
                if has_begun:
                    self._begin_epoch()
                has_begun = True
                self._forward(connection)
                is_over = True
            except EndOfStream:
                is_over = True
            except ChannelClosed:
                pass  # `Processes` decides whether there is another
            except Flushing:
                if self._link.stopping.is_set():
                    raise

    def _begin_epoch(self) -> None:
        """Begins a new epoch for the frames of a new writer."""
        self._epoch_offset = self._highest_epoch + 1
        self._number_offset = self._highest_number + 1 if self._link.renumbers else 0
        self._is_first_of_epoch = True
        event = DiscontinuityEvent(self._epoch_offset, "the process upstream was started again")
        self._pad.send_event(event)

    def _forward(self, connection: Connection) -> None:
        """Forwards what is received through a connection, until EOS."""
        link = self._link
        decoder = StreamDecoder(link.packages)
        while True:
            if link.stopping.is_set():
                raise Flushing(link.name)
            for message in link.receive(connection.channel):
                item = decoder.decode(message, connection.channel)
                link.begin_ns = decoder.begin_ns
                if isinstance(item, EosEvent):
                    link.before_end()
                    return
                if item is not None:
                    self._forward_item(item, connection)
                item = None  # else its slot would be in use until the next one
                connection.released.put(decoder.slots.released)

    def _forward_item(self, item: Frame | Event, connection: Connection) -> None:
        """Forwards a frame or an event; a flush drops it."""
        try:
            if isinstance(item, Frame):
                self._push(item, connection)
            elif isinstance(item, DiscontinuityEvent):
                self._pad.send_event(dataclasses.replace(item, epoch=item.epoch + self._epoch_offset))
            else:
                self._pad.send_event(item)
        except Flushing:
            if self._link.stopping.is_set():
                raise
            if isinstance(item, Frame):
                self._link.count_drop("flushed")

    def _push(self, frame: Frame, connection: Connection) -> None:
        frame = self._pad.announce_caps(self._continued(frame))
        try:
            self._begin_push()
            if connection.counts[TAKEN] < connection.counts[FLUSHED]:
                raise Flushing(self._link.name)
            self._pad.push(frame)
        except Flushing:
            raise
        except (FlowStop, StreamkitError):
            connection.counts[REFUSED] = 1
            raise
        finally:
            with self._link.changed:
                self._pushing_thread = 0
                self._link.changed.notify_all()
            connection.counts[TAKEN] += 1
            if connection.counts[WAITING]:
                with contextlib.suppress(ChannelClosed):
                    connection.channel.send(b"", (), self._link.stopping.is_set)

    def _begin_push(self) -> None:
        """Waits until no flush is in progress; one that begins from now on waits for the frame.

        Raises:
            Flushing: the pipeline stops; the frame has not been forwarded.
        """
        link = self._link
        with link.changed:
            if link.is_flushing:
                wait_until(link.changed, lambda: not link.is_flushing, None, link.stopping)
            if not link.stopping.is_set():
                self._pushing_thread = threading.get_ident()
                return
        link.count_drop("pipeline stopped")
        raise Flushing(link.name)

    def _continued(self, frame: Frame) -> Frame:
        """The frame with the epoch and number that follow those from before a restart."""
        self._link.last_frame[0] = frame.seq
        epoch, seq = frame.epoch + self._epoch_offset, frame.seq + self._number_offset
        self._highest_epoch = max(self._highest_epoch, epoch)
        self._highest_number = max(self._highest_number, seq)
        if self._epoch_offset:
            flags = frame.flags | FrameFlags.DISCONTINUITY if self._is_first_of_epoch else frame.flags
            self._is_first_of_epoch = False
            frame = frame.replace(epoch=epoch, seq=seq, flags=flags)
        return frame
