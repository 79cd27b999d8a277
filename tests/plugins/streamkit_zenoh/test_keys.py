"""Publishers and receivers derive the same zenoh keys from a user's key."""

import pytest

from streamkit_zenoh.keys import (
    InvalidKey,
    alive_key,
    listening_key,
    listens_to,
    publication_root,
    records_key,
)


@pytest.mark.parametrize(
    ("key", "expected"),
    [
        ("uav/1", "uav/1/tracks"),
        ("uav/1/tracks", "uav/1/tracks"),
        ("uav/*", "uav/*/tracks"),
        ("uav/**", "uav/**/tracks"),
        ("tracks", "tracks"),
        ("mytracks", "mytracks/tracks"),
    ],
)
def test_records_go_below_the_key(key: str, expected: str) -> None:
    """`tracks` is appended unless it is there; wildcards stay."""
    assert records_key(key) == expected
    assert alive_key(records_key(key)) == expected.removesuffix("tracks") + "alive"


@pytest.mark.parametrize("key", ["", "/uav", "uav/", "uav//1", "uav/#", "uav/1?x=2", "a*b", " ", "uav/1 "])
def test_malformed_keys_are_refused(key: str) -> None:
    """The error shows the key and a valid one."""
    with pytest.raises(InvalidKey, match="for example uav/1"):
        records_key(key)


@pytest.mark.parametrize("key", ["uav/*", "**", "uav/*/tracks"])
def test_publishers_need_one_key(key: str) -> None:
    """A publisher with wildcards would publish at the keys of others."""
    with pytest.raises(InvalidKey, match="wildcards"):
        publication_root(key)


def test_streams_of_a_publisher_are_below_its_root() -> None:
    """With or without `tracks`; `tracks` alone leaves no root."""
    assert publication_root("uav/1") == publication_root("uav/1/tracks") == "uav/1"
    with pytest.raises(InvalidKey, match="must be more than 'tracks'"):
        publication_root("tracks")


@pytest.mark.parametrize(
    ("receiver", "expected"),
    [("uav/1", True), ("uav/*", True), ("**", True), ("uav/2", False), ("uav", False), ("uav/1/x", False)],
)
def test_a_receivers_token_holds_its_key_expression(receiver: str, expected: bool) -> None:
    """Wildcards are escaped in a token, which may have none."""
    token = listening_key("abc", records_key(receiver))
    assert "*" not in token
    assert listens_to(token, "uav/1/tracks") is expected


def test_a_malformed_token_is_no_receiver() -> None:
    """Tokens come from the network."""
    assert not listens_to("streamkit/listening/abc/%2F%2F%23", "uav/1/tracks")
