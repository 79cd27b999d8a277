"""From frames to the pictures that are published: KEY/frame at a rate, KEY/mosaic when it has changed."""

import threading
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import zenoh

from streamkit import Frame
from streamkit_zenoh.publish.answers import Answer
from streamkit_zenoh.publish.line import SendingLine
from streamkit_zenoh.publish.outlet import Outlet
from streamkit_zenoh.wire.frame_header import frame_header
from streamkit_zenoh.wire.numbering import Stamp
from streamkit_zenoh.wire.pictures import PictureFormat, displayable, encode_picture, scaled_to_width


@dataclass(frozen=True)
class PictureSettings:
    """How pictures are published.

    Attributes:
        source: named in the header.
        form: JPEG or PNG.
        quality: of JPEG, 1 to 100.
        width: pictures wider than this are scaled to it; 0 leaves them.
        every_ns: least time between two, on the frames' own clock; 0 takes each.
        on_change: whether one that is as the last one was is left out.
    """

    source: str
    form: PictureFormat
    quality: int
    width: int
    every_ns: int
    on_change: bool


class PictureFeed:
    """Takes the frames that are due, and encodes and sends the newest one in a thread of its own."""

    def __init__(
        self,
        outlet: Outlet,
        settings: PictureSettings,
        utc_ns: Callable[[], int],
        failed: Callable[[Exception], None],
    ) -> None:
        self.outlet = outlet
        self._settings = settings
        self._utc_ns = utc_ns
        self._failed = failed
        self._answerable: tuple[Frame, Stamp] | None = None
        self._due: tuple[int, int] | None = None
        self._checksum: int | None = None
        self.line: SendingLine[tuple[Frame, Stamp]] = SendingLine(self._send, 1, self._not_sent)

    def submit(self, frame: Frame, now_ns: int) -> None:
        """Takes a frame; where one waits that has not been sent, this one takes its place."""
        if not self._is_due(frame, now_ns):
            return
        item = (frame, self.outlet.stamp())
        if not self.outlet.is_wanted:
            self._answerable = item
            self.outlet.settle(item[1])
        else:
            replaced = self.line.submit(item, 0.0, _NEVER)
            if replaced:
                self.outlet.count_drop("replaced by a newer one", replaced)

    def answers(self, asked: zenoh.KeyExpr) -> Iterable[Answer]:
        """The last picture, where it is asked for."""
        if self._answerable is not None and asked.intersects(self.outlet.key):
            payload, attachment = self._encoded(*self._answerable)
            yield Answer(self.outlet.key, payload, self.outlet.encoding, attachment)

    def _is_due(self, frame: Frame, now_ns: int) -> bool:
        if self._settings.on_change and not self._has_changed(frame):
            return False
        if not self._settings.every_ns:
            return True
        time_ns = now_ns if frame.pts is None else frame.pts
        if self._due is not None and self._due[1] == frame.epoch and time_ns < self._due[0]:
            return False
        due_ns = time_ns if self._due is None or self._due[1] != frame.epoch else self._due[0]
        # Kept on the grid of the rate: else 30 frames a second at a rate of 20 would become 15.
        behind = max(0, time_ns - due_ns) // self._settings.every_ns
        self._due = (due_ns + (behind + 1) * self._settings.every_ns, frame.epoch)
        return True

    def _has_changed(self, frame: Frame) -> bool:
        checksum = zlib.crc32(np.ascontiguousarray(frame.data).data)
        changed = checksum != self._checksum
        self._checksum = checksum
        return changed

    def _encoded(self, frame: Frame, stamp: Stamp) -> tuple[bytes, bytes]:
        settings = self._settings
        picture = scaled_to_width(displayable(frame.data, str(frame.caps["format"])), settings.width)
        dropped = self.outlet.drops.total()
        header = frame_header(frame, settings.source, self._utc_ns(), dropped, picture.shape)
        return encode_picture(picture, settings.form, settings.quality), stamp.attachment(header)

    def _send(self, item: tuple[Frame, Stamp]) -> None:
        self.outlet.put(*self._encoded(*item))
        self._answerable = item
        self.outlet.settle(item[1])

    def _not_sent(self, error: Exception) -> None:
        self.outlet.count_drop("not sent", 1)
        self._failed(error)


_NEVER = threading.Event()
