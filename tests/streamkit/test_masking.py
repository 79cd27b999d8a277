"""Masking of secrets."""

import time

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from streamkit import DescriptionError, Message, MessageKind, Pipeline, ResourceError
from streamkit.masking import TEXT_LIMIT, bounded, mask_secrets, presentable_value, star_secrets


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("rtsp://user:pa/ss@cam/live", "rtsp://***@cam/live"),
        ("rtsp://user:pa#ss@cam/live", "rtsp://***@cam/live"),
        ("rtsp://user:pa?ss@cam/live", "rtsp://***@cam/live"),
        ("rtsp://user:pa ss@cam/live", "rtsp://***@cam/live"),
        ("rtsp://user:/pass@cam/live", "rtsp://***@cam/live"),
        ("rtsp://user:12/34@cam/live", "rtsp://***@cam/live"),
        ("rtsp://u%3Ap/w@cam/live", "rtsp://***@cam/live"),
        ("rtsp://token@cam/mail@home", "rtsp://***@cam/mail@home"),
        ("rtsp:/user:pa/ss/x: not there", "rtsp:/***: not there"),
        ("rtsp://u:p@a b rtsp://v:q@c", "rtsp://***@a b rtsp://***@c"),
        ("filesrc location=rtsp://u:p q@h ! x @preset=1", "filesrc location=rtsp://***@h ! x @preset=1"),
        ("user:pass@cam", "***@cam"),
        ("location='user:pass@cam'", "location='***@cam'"),
        ("tcp/me:pass@host:1 is down", "***@host:1 is down"),
        ("rtsp://cam/user=a_password=b_c_channel=1", "rtsp://cam/user=a_password=***_channel=1"),
        ("http://cam/?user=a&pwd=b/c&size=2", "http://cam/?user=a&pwd=***&size=2"),
        ("http://cam/cgi?loginuse=a&loginpas=b&rate=1", "http://cam/cgi?loginuse=a&loginpas=***&rate=1"),
        ("https://h/x.mp4?X-Amz-Signature=ab&x=1", "https://h/x.mp4?X-Amz-Signature=***&x=1"),
        ("https://h/x.m3u8?jwt=a.b.c", "https://h/x.m3u8?jwt=***"),
        ("{'password': 'a b', \"api_key\": \"c\"}", "{'password': '***', \"api_key\": \"***\"}"),
        ("tls/host:1#root=a;key=b, tcp/x:2", "tls/host:1#***, tcp/x:2"),
        ("tcp/token@host:1", "tcp/***@host:1"),
        ("Authorization: Basic YTpi", "Authorization: ***"),
    ],
)
def test_secrets_are_masked(text: str, shown: str) -> None:
    """Every form, up to the last @ where a password may hold what ends an address."""
    assert mask_secrets(text) == shown
    assert len(star_secrets(text)) == len(text)


@pytest.mark.parametrize(
    "text",
    [
        "rtsp://cam/mail@home",
        "rtsp://cam:554/live: refused; write rtsp://host:port/path",
        "rtsp://[::1]:554/live",
        "udp://HOST:PORT or tcp://HOST:PORT.",
        "location=rtsp://${host:-cam}:${port:-554}/x user-pw=${password}",
        "file:///videos/a:b@c.mp4",
        "/videos/12:30@cam.mp4",
        "zenohsink key=uav/1",
        "track.pipe:3:9: no element",
        "filesrc0: frame seq=12 pts=0.480 s",
        "video/x-raw, format={ GRAY8, BGR }, width=[ 1, 4096 ]",
    ],
)
def test_text_without_secrets_is_unchanged(text: str) -> None:
    """Also similar forms."""
    assert mask_secrets(text) == text


PARTS = st.sampled_from(
    ["rtsp://", "tcp/", "user", ":", "pw", "@", "/", "#", "?", " ", "password=", "'", '"', "&", "_", "host",
     "=", "\n", " ! ", "file:///", "${x}", "***", "1"]
)  # fmt: skip


@example("password=rtsp://&@")  # the mask and what follows it are one value
@given(st.lists(PARTS, max_size=24).map("".join))
def test_masking_twice_changes_nothing(text: str) -> None:
    """An error that is passed on inside another keeps its text."""
    once = mask_secrets(text)
    assert mask_secrets(once) == once
    assert star_secrets(text).count("\n") == text.count("\n")


PASSWORDS = st.text(st.characters(codec="utf-8", exclude_characters="\n\r\x85\u2028\u2029\v\f"), min_size=1)


@given(PASSWORDS)
def test_no_password_of_an_address_shows(password: str) -> None:
    """Whatever characters it has, but for line breaks."""
    planted = f"<{password}>"
    assert planted not in mask_secrets(f"cannot open rtsp://user:{planted}@host/live: refused")


@pytest.mark.parametrize(
    "piece",
    ["rtsp://", "password=", "a:b@ ", "= '", "${", "authorization: ", "token-", "@", "tcp/a", "tcp/a:1"],
)
def test_masking_takes_time_in_proportion(piece: str) -> None:
    """Sixteen times a text of any form takes no sixty-four times as long, also where the form never ends."""

    def cost_s(size: int) -> float:
        began = time.process_time()
        mask_secrets(piece * (size // len(piece)) + ":=@")
        return time.process_time() - began

    once = min(cost_s(15_000) for _ in range(3))
    assert min(cost_s(240_000) for _ in range(2)) < 64 * max(once, 0.00125)


def test_long_texts_are_bounded_and_say_so() -> None:
    """Errors and messages of a megabyte keep their beginning and end, and tell how much is left out."""
    text = "a" * 1_000_000 + "the reason"
    expected = " ... (996010 characters left out) ... "
    for shown in (str(ResourceError(text)), Message(MessageKind.WARNING, "x", text).text, bounded(text)):
        assert expected in shown
        assert shown.endswith("the reason")
        assert len(shown) == TEXT_LIMIT + len(expected)


def test_fields_of_messages_are_masked() -> None:
    """Also within lists and mappings; numbers and names of secrets stay."""
    fields = {"location": "rtsp://u:p@h", "tries": 3, "more": ["user:p@h", {"password": "p"}]}
    message = Message(MessageKind.ELEMENT, "x", "connection", fields)
    assert message.fields == {"location": "rtsp://***@h", "tries": 3, "more": ["***@h", {"password": "***"}]}
    assert presentable_value(MessageKind.ERROR) is MessageKind.ERROR


def test_a_description_error_with_a_megabyte_in_it_is_short() -> None:
    """The name of an element is shown, but not all of it."""
    with pytest.raises(DescriptionError, match="characters left out") as caught:
        Pipeline.parse("a" * 900_000)
    assert len(str(caught.value)) < 2 * TEXT_LIMIT
    assert len(caught.value.pointed("a" * 900_000)) < 3 * TEXT_LIMIT


def test_a_password_with_a_blank_is_masked() -> None:
    """Its words are parsed as unknown elements, which the error does not name."""
    text = "rtspsrc location=rtsp://user:first second@host/live ! fakesink"
    with pytest.raises(DescriptionError, match="\\*\\*\\*") as caught:
        Pipeline.parse(text)
    shown = str(caught.value) + caught.value.pointed(text) + caught.value.message + caught.value.hint
    assert "first" not in shown
    assert "second" not in shown
