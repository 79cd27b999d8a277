"""VideoPublisher: coded packets as the camera sent them, at KEY/video."""

from collections.abc import Callable, Iterable

import zenoh

from streamkit import Frame
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_zenoh.publish.numbered_publisher import NumberedPublisher, Reply
from streamkit_zenoh.wire.numbering import Stamp
from streamkit_zenoh.wire.video_header import video_header

# Two seconds of video may wait for a slow network; then receivers see a gap, and go on at the next keyframe.
CAPACITY = 64


class VideoPublisher:
    """Publishes packets in a thread of its own; does nothing while there is no subscriber.

    Args:
        publisher: of the stream `video`.
        source: name of the publisher, in each header.
        utc_ns: the clock.
        failed: called in the thread with what publishing raised.

    Attributes:
        executor: the thread.
    """

    def __init__(
        self,
        publisher: NumberedPublisher,
        source: str,
        utc_ns: Callable[[], int],
        failed: Callable[[Exception], None],
    ) -> None:
        self.publisher = publisher
        self._source = source
        self._utc_ns = utc_ns
        self._failed = failed
        self.executor = BackgroundExecutor("zenoh video", self._not_sent, capacity=CAPACITY)

    def submit(self, frame: Frame, now_ns: int) -> None:
        """Queues a packet; a full queue drops the oldest one."""
        stamp = self.publisher.stamp()
        if not self.publisher.has_subscriber:
            self.publisher.settle(stamp)
        elif dropped := self.executor.submit_dropping(lambda: self._send(frame, stamp)):
            self.publisher.count_drop("queue full", dropped)

    def replies(self, asked: zenoh.KeyExpr) -> Iterable[Reply]:
        """None: a single packet is of no use."""
        return ()

    def _send(self, frame: Frame, stamp: Stamp) -> None:
        header = video_header(frame, self._source, self._utc_ns())
        self.publisher.put(bytes(frame.data), stamp.attachment(header))
        self.publisher.settle(stamp)

    def _not_sent(self, error: Exception) -> None:
        self.publisher.count_drop("not sent", 1)
        self._failed(error)
