"""FramePublisher: frames as images, KEY/frame at a rate and KEY/mosaic when it has changed."""

import zlib
from collections.abc import Callable, Iterable

import numpy as np
import zenoh

from streamkit import Frame
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_zenoh.keys import MOSAIC
from streamkit_zenoh.publish.numbered_publisher import NumberedPublisher, Reply
from streamkit_zenoh.publish.settings import PublicationSettings
from streamkit_zenoh.wire.frame_header import frame_header
from streamkit_zenoh.wire.images import encode_image, grey_or_bgr, scaled_to_width
from streamkit_zenoh.wire.numbering import Stamp


class FramePublisher:
    """Selects the frames that are due; encodes and publishes the newest one in a thread of its own.

    Frames are scaled and published at the rate of the settings, by their own clock; a mosaic is published
    whole, and only when its pixels have changed.

    Args:
        publisher: of the stream `frame` or `mosaic`.
        settings: format, quality, size and rate.
        utc_ns: the clock.
        failed: called in the thread with what encoding or publishing raised.

    Attributes:
        executor: the thread.
    """

    def __init__(
        self,
        publisher: NumberedPublisher,
        settings: PublicationSettings,
        utc_ns: Callable[[], int],
        failed: Callable[[Exception], None],
    ) -> None:
        self.publisher = publisher
        self._settings = settings
        self._is_mosaic = publisher.name == MOSAIC
        rate = 0.0 if self._is_mosaic else settings.frame_rate
        self._every_ns = round(1e9 / rate) if rate else 0
        self._utc_ns = utc_ns
        self._failed = failed
        self._last: tuple[Frame, Stamp] | None = None
        self._due: tuple[int, int] | None = None
        self._checksum: int | None = None
        self.executor = BackgroundExecutor(f"zenoh {publisher.name}", self._not_sent, capacity=1)

    def submit(self, frame: Frame, now_ns: int) -> None:
        """Queues a frame if it is due, replacing a queued one; `now_ns` stands in for a missing pts."""
        if (self._is_mosaic and not self._has_changed(frame)) or not self._is_due(frame, now_ns):
            return
        stamp = self.publisher.stamp()
        if not self.publisher.has_subscriber:
            self._settle(frame, stamp)
        elif replaced := self.executor.submit_dropping(lambda: self._send(frame, stamp)):
            self.publisher.count_drop("replaced by a newer one", replaced)

    def replies(self, asked: zenoh.KeyExpr) -> Iterable[Reply]:
        """The last image, for a query that matches its key."""
        if self._last is not None and asked.intersects(self.publisher.key):
            payload, attachment = self._encoded(*self._last)
            yield Reply(self.publisher.key, payload, self.publisher.encoding, attachment)

    def _is_due(self, frame: Frame, now_ns: int) -> bool:
        if not self._every_ns:
            return True
        time_ns = now_ns if frame.pts is None else frame.pts
        if self._due is not None and self._due[1] == frame.epoch and time_ns < self._due[0]:
            return False
        due_ns = time_ns if self._due is None or self._due[1] != frame.epoch else self._due[0]
        # Due times stay multiples of the period: else 30 frames a second at a rate of 20 would become 15.
        behind = max(0, time_ns - due_ns) // self._every_ns
        self._due = (due_ns + (behind + 1) * self._every_ns, frame.epoch)
        return True

    def _has_changed(self, frame: Frame) -> bool:
        checksum = zlib.crc32(np.ascontiguousarray(frame.data).data)
        changed = checksum != self._checksum
        self._checksum = checksum
        return changed

    def _encoded(self, frame: Frame, stamp: Stamp) -> tuple[bytes, bytes]:
        settings, image = self._settings, grey_or_bgr(frame.data, str(frame.caps["format"]))
        image_format = settings.mosaic_format
        if not self._is_mosaic:
            image_format, image = settings.frame_format, scaled_to_width(image, settings.frame_width)
        header = frame_header(frame, settings.key, self._utc_ns(), self.publisher.drops.total(), image.shape)
        return encode_image(image, image_format, settings.picture_quality), stamp.attachment(header)

    def _send(self, frame: Frame, stamp: Stamp) -> None:
        self.publisher.put(*self._encoded(frame, stamp))
        self._settle(frame, stamp)

    def _settle(self, frame: Frame, stamp: Stamp) -> None:
        self._last = (frame, stamp)
        self.publisher.settle(stamp)

    def _not_sent(self, error: Exception) -> None:
        self.publisher.count_drop("not sent", 1)
        self._failed(error)
