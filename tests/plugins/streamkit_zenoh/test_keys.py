"""One rule turns a user's key into the keys on zenoh, on both sides."""

import pytest

from streamkit_zenoh.keys import (
    InvalidKey,
    alive_key,
    listening_key,
    listens_to,
    publication_key,
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
    """`tracks` is added unless it is there; wildcards stay."""
    assert records_key(key) == expected
    assert alive_key(records_key(key)) == expected.removesuffix("tracks") + "alive"


@pytest.mark.parametrize("key", ["", "/uav", "uav/", "uav//1", "uav/#", "uav/1?x=2", "a*b"])
def test_what_is_no_key_is_refused(key: str) -> None:
    """The error shows the key and a good one."""
    with pytest.raises(InvalidKey, match="for example uav/1"):
        records_key(key)


@pytest.mark.parametrize("key", ["uav/*", "**", "uav/*/tracks"])
def test_publishers_need_one_key(key: str) -> None:
    """A publisher with wildcards would speak for others."""
    with pytest.raises(InvalidKey, match="wildcards"):
        publication_key(key)


@pytest.mark.parametrize(
    ("receiver", "expected"),
    [("uav/1", True), ("uav/*", True), ("**", True), ("uav/2", False), ("uav", False), ("uav/1/x", False)],
)
def test_a_receivers_token_tells_what_it_receives(receiver: str, expected: bool) -> None:
    """A key expression with wildcards survives the way through a token, which may have none."""
    token = listening_key("abc", records_key(receiver))
    assert "*" not in token
    assert listens_to(token, publication_key("uav/1")) is expected


def test_a_foreign_token_counts_for_nothing() -> None:
    """Tokens come from the network: one that makes no sense is no receiver."""
    assert not listens_to("streamkit/listening/abc/%2F%2F%23", "uav/1/tracks")
