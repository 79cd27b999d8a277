"""VideoSender: coded packets as the camera sent them, at KEY/video."""

from typing_extensions import override

from streamkit import Frame
from streamkit_zenoh.publish.frame_sender import MediaSender
from streamkit_zenoh.wire.numbering import Stamp
from streamkit_zenoh.wire.video_header import video_header


class VideoSender(MediaSender):
    """Publishes packets unchanged, if there is a subscriber."""

    # Two seconds may wait for a slow network; then receivers see a gap, and go on at the next keyframe.
    capacity = 64
    drop_reason = "queue full"

    @override
    def encoded(self, frame: Frame, stamp: Stamp) -> tuple[bytes, bytes]:
        header = video_header(frame, self.settings.key, self.utc_ns())
        return bytes(frame.data), stamp.attachment(header)
