"""Senders of images (KEY/frame, KEY/mosaic) and packets (KEY/video), each with a thread of its own."""

import zlib
from collections.abc import Callable, Iterable
from typing import ClassVar

import numpy as np
import zenoh
from typing_extensions import override

from streamkit import Frame
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_zenoh.keys import MOSAIC
from streamkit_zenoh.publish.numbered_stream import NumberedStream, Reply
from streamkit_zenoh.publish.settings import PublicationSettings
from streamkit_zenoh.wire.frame_header import frame_header
from streamkit_zenoh.wire.images import encode_image, grey_or_bgr, scaled_to_width
from streamkit_zenoh.wire.numbering import Stamp
from streamkit_zenoh.wire.video_header import video_header


class MediaSender:
    """Encodes and publishes the frames that are due in a thread of its own; a full queue drops the oldest.

    Args:
        stream: numbered and published.
        settings: of the publication.
        utc_ns: the clock.
        failed: called in the thread with what encoding or publishing raised.

    Attributes:
        executor: the thread.
    """

    capacity: ClassVar[int]
    drop_reason: ClassVar[str]

    def __init__(
        self,
        stream: NumberedStream,
        settings: PublicationSettings,
        utc_ns: Callable[[], int],
        failed: Callable[[Exception], None],
    ) -> None:
        self.stream = stream
        self.settings = settings
        self.utc_ns = utc_ns
        self.last: tuple[Frame, Stamp] | None = None
        self._failed = failed
        self.executor = BackgroundExecutor(f"zenoh {stream.name}", self._not_sent, capacity=self.capacity)

    def submit(self, frame: Frame, now_ns: int) -> None:
        """Queues a frame if it is due; `now_ns` stands in for a missing pts."""
        if not self.is_due(frame, now_ns):
            return
        stamp = self.stream.stamp()
        if not self.stream.has_subscriber:
            self._settle(frame, stamp)
        elif dropped := self.executor.submit_dropping(lambda: self._send(frame, stamp)):
            self.count_lost(dropped, self.drop_reason)

    def count_lost(self, count: int, reason: str) -> None:
        """Counts messages that were not sent."""
        self.stream.count_drop(reason, count)

    def is_due(self, frame: Frame, now_ns: int) -> bool:
        """Whether to publish a frame."""
        return True

    def encoded(self, frame: Frame, stamp: Stamp) -> tuple[bytes, bytes]:
        """Payload and attachment."""
        raise NotImplementedError

    def replies(self, asked: zenoh.KeyExpr) -> Iterable[Reply]:
        """The last message, for a query that matches its key; none where it is of no use alone."""
        return ()

    def _send(self, frame: Frame, stamp: Stamp) -> None:
        self.stream.put(*self.encoded(frame, stamp))
        self._settle(frame, stamp)

    def _settle(self, frame: Frame, stamp: Stamp) -> None:
        self.last = (frame, stamp)
        self.stream.settle(stamp)

    def _not_sent(self, error: Exception) -> None:
        self.count_lost(1, "not sent")
        self._failed(error)


class FrameSender(MediaSender):
    """Publishes the newest frame as an image, by the frames' own clock at the rate of the settings.

    A mosaic is published whole, and only when its pixels have changed.
    """

    capacity = 1
    drop_reason = "replaced by a newer one"

    _due: tuple[int, int] | None = None
    _checksum: int | None = None

    @override
    def replies(self, asked: zenoh.KeyExpr) -> Iterable[Reply]:
        if self.last is not None and asked.intersects(self.stream.key):
            payload, attachment = self.encoded(*self.last)
            yield Reply(self.stream.key, payload, self.stream.encoding, attachment)

    @override
    def is_due(self, frame: Frame, now_ns: int) -> bool:
        if self.stream.name == MOSAIC:
            return self._has_changed(frame)
        if not self.settings.frame_rate:
            return True
        every_ns = round(1e9 / self.settings.frame_rate)
        time_ns = now_ns if frame.pts is None else frame.pts
        if self._due is not None and self._due[1] == frame.epoch and time_ns < self._due[0]:
            return False
        due_ns = time_ns if self._due is None or self._due[1] != frame.epoch else self._due[0]
        # Due times stay multiples of the period: else 30 frames a second at a rate of 20 would become 15.
        behind = max(0, time_ns - due_ns) // every_ns
        self._due = (due_ns + (behind + 1) * every_ns, frame.epoch)
        return True

    def _has_changed(self, frame: Frame) -> bool:
        checksum = zlib.crc32(np.ascontiguousarray(frame.data).data)
        changed = checksum != self._checksum
        self._checksum = checksum
        return changed

    @override
    def encoded(self, frame: Frame, stamp: Stamp) -> tuple[bytes, bytes]:
        settings, image = self.settings, grey_or_bgr(frame.data, str(frame.caps["format"]))
        image_format = settings.mosaic_format
        if self.stream.name != MOSAIC:
            image_format, image = settings.frame_format, scaled_to_width(image, settings.frame_width)
        header = frame_header(frame, settings.key, self.utc_ns(), self.stream.dropped, image.shape)
        return encode_image(image, image_format, settings.picture_quality), stamp.attachment(header)


class VideoSender(MediaSender):
    """Publishes packets unchanged, if there is a subscriber."""

    # Two seconds may wait for a slow network; then receivers see a gap, and go on at the next keyframe.
    capacity = 64
    drop_reason = "queue full"

    @override
    def encoded(self, frame: Frame, stamp: Stamp) -> tuple[bytes, bytes]:
        header = video_header(frame, self.settings.key, self.utc_ns())
        return bytes(frame.data), stamp.attachment(header)
