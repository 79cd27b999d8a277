"""Live input from a camera of this machine, by Video4Linux."""

from __future__ import annotations

import errno
import fcntl
import os
import re
import struct
from collections.abc import Iterator, Sequence
from urllib.parse import parse_qsl, urlsplit

import av
from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream
from typing_extensions import override

from streamkit import ResourceError, StreamError
from streamkit_media.failures import MEDIA_ERRORS, ConnectionLost, reason_of
from streamkit_media.live.liveinput import LiveInput
from streamkit_media.live.sockets import DESCRIPTORS
from streamkit_media.streams import read_packets

SCHEME = "v4l2"
NAME = re.compile(r"\d{1,2}|/dev/video\d+")  # without the scheme: as OpenCV names a camera, or its device
OPTIONS = ("video_size", "framerate", "input_format")  # of FFmpeg's device that a URL may choose
EXAMPLE = "v4l2:///dev/video0?video_size=1280x720&framerate=30&input_format=mjpeg"
STREAM_OFF = 0x40045613  # VIDIOC_STREAMOFF, _IOW('V', 19, int)
CAPTURE_QUEUE = struct.pack("=i", 1)  # V4L2_BUF_TYPE_VIDEO_CAPTURE
REMEDIES = {
    errno.ENOENT: "check the name: ls /dev/video*",
    errno.EBUSY: "end the other program that uses it",
    errno.EACCES: "your user must be in the group video",
    errno.ENOTTY: "this device is no camera; another /dev/video* may be",
}


def camera_device(location: str) -> str:
    """The device of a camera: `v4l2:///dev/video0`, `/dev/video0` or `0`; "" where the location is none."""
    if NAME.fullmatch(location):
        return f"/dev/video{location}" if location.isdecimal() else location
    parts = urlsplit(location)
    return parts.path if parts.scheme == SCHEME and not parts.netloc else ""


def camera_options(location: str) -> dict[str, str]:
    """What the URL of a camera asks for, after its `?`.

    Raises:
        ValueError: it asks for something else than FFmpeg's device offers here.
    """
    found = dict(parse_qsl(urlsplit(location).query, keep_blank_values=True))
    if unknown := found.keys() - set(OPTIONS):
        raise ValueError(f"a camera has {', '.join(OPTIONS)}, got {min(unknown)}; write {EXAMPLE}")
    return found


class CameraInput(LiveInput):
    """A camera: FFmpeg reads its device, and `cut` ends a wait for the next frame.

    Args:
        location: as `camera_device` takes it.
        timeout_s: limit for each frame; the connection's watchdog keeps it, FFmpeg has none here.
    """

    def __init__(self, location: str, timeout_s: float) -> None:
        super().__init__(location, timeout_s)
        self._device = camera_device(location)

    @override
    def open(self) -> InputContainer:
        try:
            return av.open(self._device, "r", format=SCHEME, options=camera_options(self.location))
        except MEDIA_ERRORS as error:
            remedy = REMEDIES.get(
                getattr(error, "errno", 0), "check what it offers: v4l2-ctl --list-formats-ext"
            )
            raise ResourceError(
                f"{self.where}: the camera gives no video: {reason_of(error)}; {remedy}"
            ) from None

    @override
    def packets(self, container: InputContainer, streams: Sequence[Stream]) -> Iterator[Packet[Stream]]:
        try:
            yield from map(copied, read_packets(container, *streams))
        except StreamError as error:
            raise ConnectionLost(f"{self.where}: {error}; check the cable of the camera") from None

    @override
    def cut(self) -> None:
        super().cut()
        for link in DESCRIPTORS.iterdir():
            try:
                if os.readlink(link) == self._device:
                    fcntl.ioctl(int(link.name), STREAM_OFF, CAPTURE_QUEUE)
            except OSError:  # closed meanwhile
                continue


def copied(packet: Packet[Stream]) -> Packet[Stream]:
    """A packet in memory of its own: the camera's is unmapped when its device is closed."""
    copy: Packet[Stream] = Packet(bytes(packet))
    copy.stream, copy.time_base, copy.pts, copy.dts = packet.stream, packet.time_base, packet.pts, packet.dts
    copy.is_keyframe = packet.is_keyframe
    return copy
