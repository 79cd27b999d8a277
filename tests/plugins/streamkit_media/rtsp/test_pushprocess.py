from collections.abc import Callable

import pytest

from streamkit_media.rtsp.pusher import PushOrder
from streamkit_media.rtsp.pushprocess import PushFailure, PushProcess


def order(port: int) -> PushOrder:
    """To connect to a port here."""
    return PushOrder(f"rtsp://127.0.0.1:{port}/live", {}, "h264", 64, 48, 0.5)


def fails(process: PushProcess) -> PushFailure:
    """What a connection fails with."""
    for _ in range(1000):
        try:
            process.check(0.05)
        except PushFailure as failure:
            return failure
    pytest.fail("the connection has neither failed nor been found silent")


def test_silence_is_distinguished_from_refusal(serve: Callable[[int], int]) -> None:
    """A server that does not answer is silent; a port that is closed gives FFmpeg's reason."""
    for port, is_silent, reason in ((serve(0), True, "silent"), (1, False, "Connection refused")):
        process = PushProcess(order(port))
        failure = fails(process)
        process.close(0)
        process.close(0)
        assert failure.is_silent is is_silent
        assert reason in failure.reason
