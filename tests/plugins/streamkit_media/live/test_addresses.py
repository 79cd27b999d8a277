import pytest

from streamkit_media.live.addresses import port_of


def test_ports() -> None:
    """The port is the URL's own or its scheme's; one that is not a number is refused."""
    assert port_of("rtsp://cam/live") == 554
    assert port_of("rtsps://cam/live") == 322
    assert port_of("rtsp://u:p@cam:8554/live") == 8554
    with pytest.raises(ValueError, match="the port must be a number"):
        port_of("rtsp://cam:abc/live")
