"""Senders of images (KEY/frame, KEY/mosaic) and packets (KEY/video)."""

import time
import zlib
from collections.abc import Callable, Iterable

import numpy as np
import zenoh
from typing_extensions import override

from streamkit import Frame, Registration
from streamkit_zenoh.keys import FRAME, MOSAIC, VIDEO
from streamkit_zenoh.publish.numbered_stream import Outgoing, Publisher, Reply, Sender
from streamkit_zenoh.wire.frame_header import FRAME_SCHEMA, frame_header
from streamkit_zenoh.wire.images import ImageFormat, encode_image, grey_or_bgr, scaled_to_width
from streamkit_zenoh.wire.video_header import VIDEO_SCHEMA, video_header

# Two seconds may wait for a slow network; then receivers see a gap, and go on at the next keyframe.
PACKET_CAPACITY = 64


class ImageSender(Sender):
    """Publishes the newest frame as an image, scaled down to a width; 0 is its own."""

    drop_reason = "replaced by a newer one"

    def __init__(self, publisher: Publisher, name: str, image_format: ImageFormat, width: int) -> None:
        self._format, self._width = image_format, width
        super().__init__(publisher, name, f"image/{image_format};{FRAME_SCHEMA}", capacity=1)

    @override
    def send(self, item: Outgoing) -> None:
        self.put(*self.encoded(item))
        self.settle(item)

    @override
    def replies(self, asked: zenoh.KeyExpr) -> Iterable[Reply]:
        if self.last is not None and asked.intersects(self.key):
            payload, attachment = self.encoded(self.last)
            yield Reply(self.key, payload, self.encoding, attachment)

    def encoded(self, item: Outgoing) -> tuple[bytes, bytes]:
        """Payload and attachment."""
        settings, frame = self.publisher.settings, item.frame
        image = scaled_to_width(grey_or_bgr(frame.data, str(frame.caps["format"])), self._width)
        now_ns, dropped = self.publisher.utc_ns(), self.dropped
        header = frame_header(frame, settings.key, now_ns, dropped, image.shape)
        return encode_image(image, self._format, settings.picture_quality), item.stamp.attachment(header)


class FrameSender(ImageSender):
    """Publishes frames by their own clock, at the rate of the settings."""

    def __init__(self, publisher: Publisher) -> None:
        settings = publisher.settings
        super().__init__(publisher, FRAME, settings.frame_format, settings.frame_width)
        self._due = 0, -1  # when the next frame is due, ns, in which epoch

    @override
    def submit(self, frame: Frame) -> None:
        if self._is_due(frame):
            super().submit(frame)

    def _is_due(self, frame: Frame) -> bool:
        if not self.publisher.settings.frame_rate:
            return True
        period_ns = round(1e9 / self.publisher.settings.frame_rate)
        time_ns = time.monotonic_ns() if frame.pts is None else frame.pts
        due_ns, epoch = self._due
        if epoch != frame.epoch:
            due_ns = time_ns
        if time_ns < due_ns:
            return False
        # Due times stay multiples of the period: else 30 frames a second at a rate of 20 would become 15.
        self._due = due_ns + ((time_ns - due_ns) // period_ns + 1) * period_ns, frame.epoch
        return True


class MosaicSender(ImageSender):
    """Publishes a mosaic whole, and only when its pixels or their place on the ground have changed."""

    def __init__(self, publisher: Publisher) -> None:
        super().__init__(publisher, MOSAIC, publisher.settings.mosaic_format, 0)
        self._last_seen: object = None

    @override
    def submit(self, frame: Frame) -> None:
        registration = frame.get(Registration)
        place = registration and (registration.reference, registration.to_reference.tobytes())
        before, self._last_seen = self._last_seen, (zlib.crc32(np.ascontiguousarray(frame.data).data), place)
        if self._last_seen != before:
            super().submit(frame)


class VideoSender(Sender):
    """Publishes packets unchanged, if there is a subscriber."""

    def __init__(self, publisher: Publisher) -> None:
        super().__init__(publisher, VIDEO, f"application/octet-stream;{VIDEO_SCHEMA}", PACKET_CAPACITY)

    @override
    def send(self, item: Outgoing) -> None:
        header = video_header(item.frame, self.publisher.settings.key, self.publisher.utc_ns())
        self.put(bytes(item.frame.data), item.stamp.attachment(header))
        self.settle(item)


MEDIA_SENDERS: dict[str, Callable[[Publisher], Sender]] = {
    FRAME: FrameSender,
    MOSAIC: MosaicSender,
    VIDEO: VideoSender,
}
