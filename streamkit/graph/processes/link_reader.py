"""LinkReader: the half of a process link that receives frames and sends them on."""

from __future__ import annotations

import contextlib
import dataclasses
from typing import TYPE_CHECKING

from streamkit.crossing.channel import ChannelClosed
from streamkit.crossing.link_counts import LinkConnection
from streamkit.crossing.stream_codec import StreamDecoder
from streamkit.element.base import POLL_S
from streamkit.errors import StreamkitError
from streamkit.flow.events import EOS, DiscontinuityEvent, EndOfStream, EosEvent, FlowStop, Flushing
from streamkit.flow.frame import Frame, FrameFlags

if TYPE_CHECKING:
    from streamkit.graph.processes.process_link import ProcessLink


class LinkReader:
    """Sends frames and events on, in a thread of the link; those of a new writer belong to a new epoch."""

    def __init__(self, link: ProcessLink) -> None:
        self._link = link
        self.reset()

    def reset(self) -> None:
        """Resets the state of an earlier run."""
        self._used: LinkConnection | None = None
        self._is_first_of_epoch = False
        self._epoch_offset = self._number_offset = 0
        self._highest_epoch, self._highest_number = 0, -1

    def run(self) -> None:
        """Sends everything on until EOS.

        Raises:
            Flushing: the pipeline stops.
        """
        while True:
            try:
                connection = self._link.open_connection()
                if self._used is not None:
                    self._used.channel.close()
                    self._begin_epoch()
                self._used = connection
                self._forward(connection)
            except ChannelClosed:
                continue  # `Processes` decides whether there is another
            except EndOfStream:
                self._link.pads["src"].send_event(EOS)
            return

    def _begin_epoch(self) -> None:
        self._epoch_offset = self._highest_epoch + 1
        self._number_offset = self._highest_number + 1 if self._link.renumbers else 0
        self._is_first_of_epoch = True
        event = DiscontinuityEvent(self._epoch_offset, "the process upstream was started again")
        self._link.pads["src"].send_event(event)

    def _forward(self, connection: LinkConnection) -> None:
        """Sends on what comes through a connection, until EOS."""
        link, channel = self._link, connection.channel
        decoder = StreamDecoder(link.packages)
        while True:
            if link.stopping.is_set():
                raise Flushing(link.name)
            for message in link.receive(channel, POLL_S):
                item = decoder.decode(message, channel)
                if isinstance(item, Frame):
                    self._push(item, decoder, connection)
                    item = None  # else its slot would be in use until the next one
                elif item is not None:
                    if isinstance(item, EosEvent):
                        link.before_end()
                    if isinstance(item, DiscontinuityEvent):
                        item = dataclasses.replace(item, epoch=item.epoch + self._epoch_offset)
                    link.pads["src"].send_event(item)
                    if isinstance(item, EosEvent):
                        return

    def _push(self, frame: Frame, decoder: StreamDecoder, connection: LinkConnection) -> None:
        src = self._link.pads["src"]
        frame = self._continued(frame)
        if frame.caps is not src.caps:
            frame = src.announce_caps(frame)
        is_over = False
        try:
            src.push(frame)
        except Flushing:
            raise
        except (FlowStop, StreamkitError):
            is_over = True
            raise
        finally:
            del frame  # its slot may be free now
            connection.counts.count_taken()
            with contextlib.suppress(ChannelClosed):
                connection.channel.send(decoder.done(is_over=is_over), (), self._link.stopping.is_set)

    def _continued(self, frame: Frame) -> Frame:
        """The frame with the epoch and number that follow those from before a restart."""
        self._link.last_frame[0] = frame.seq
        self._highest_epoch = frame.epoch + self._epoch_offset
        self._highest_number = max(self._highest_number, frame.seq + self._number_offset)
        if self._epoch_offset:
            flags = frame.flags | FrameFlags.DISCONTINUITY if self._is_first_of_epoch else frame.flags
            self._is_first_of_epoch = False
            frame = frame.replace(epoch=self._highest_epoch, seq=frame.seq + self._number_offset, flags=flags)
        return frame
