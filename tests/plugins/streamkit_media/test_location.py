import pytest

from streamkit import mask_secrets
from streamkit.output.names import is_network, lacks_protocol
from streamkit_media.container import with_credentials


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("rtsp://user:secret@cam/live", "rtsp://***@cam/live"),
        ("rtsp://user:se@cret@cam:554/live", "rtsp://***@cam:554/live"),
        ("cannot open rtsp://u:p@a and http://v:q@b", "cannot open rtsp://***@a and http://***@b"),
        ("http://cam/video?token=abc&size=2", "http://cam/video?token=***&size=2"),
        ("http://cam/video?size=2&Password=abc", "http://cam/video?size=2&Password=***"),
        ("rtsp://cam/mail@home", "rtsp://cam/mail@home"),
        ("/videos/a@b.mp4", "/videos/a@b.mp4"),
    ],
)
def test_redact_masks_secrets_and_nothing_else(text: str, shown: str) -> None:
    """User information and secret query fields become ***, all else stays."""
    assert mask_secrets(text) == shown


def test_credentials_are_put_into_urls_that_have_none() -> None:
    """What has a meaning in a URL is escaped; a URL with a user of its own stays as it is."""
    assert with_credentials("rtsp://cam/live", "me", "p@ss/word") == "rtsp://me:p%40ss%2Fword@cam/live"
    assert with_credentials("rtsp://you@cam/live", "me", "word") == "rtsp://you@cam/live"
    assert with_credentials("rtsp://cam/live", "", "word") == "rtsp://cam/live"


def test_is_network_distinguishes_urls_from_files() -> None:
    """Any URL but file:// is reached over the network; a colon alone makes no URL."""
    assert is_network("rtsp://cam/live")
    assert not is_network("file:///videos/a.mp4")
    assert not is_network("a:b.mp4")


@pytest.mark.parametrize(
    ("location", "expected"),
    [
        ("10.0.0.7:554/live", True),
        ("camera.local:8554", True),
        ("localhost:8554/live", True),
        ("user:secret@host", True),
        ("user:p@ss/word@host/live", True),
        ("rtsp://user:secret@host/live", False),
        ("rtsp://10.0.0.7:554/live", False),
        ("file:///a.b:1/c", False),
        ("flights/12:30/a.mp4", False),
        ("12:30.mp4", False),
        ("uav/1", False),
        ("uav:1/x", False),
        ("team@uav/1", False),
    ],
)
def test_lacks_protocol_tells_a_bare_address_from_files_and_keys(location: str, expected: bool) -> None:
    """A password, or localhost or a dotted host with a port, shows it; a time or an @ in a name does not."""
    assert lacks_protocol(location) is expected
