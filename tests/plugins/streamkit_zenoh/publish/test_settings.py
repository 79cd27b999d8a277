"""Quality of service is parsed from words in any order."""

import pytest
import zenoh

from streamkit_zenoh.publish.settings import InvalidQos, Qos, parse_qos


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", Qos(zenoh.CongestionControl.BLOCK, zenoh.Priority.DATA, False)),
        ("drop", Qos(zenoh.CongestionControl.DROP, zenoh.Priority.DATA, False)),
        ("express, real-time ,block", Qos(zenoh.CongestionControl.BLOCK, zenoh.Priority.REAL_TIME, True)),
        ("background,drop", Qos(zenoh.CongestionControl.DROP, zenoh.Priority.BACKGROUND, False)),
    ],
)
def test_words_may_have_any_order(text: str, expected: Qos) -> None:
    """The default is block and data."""
    assert parse_qos(text) == expected


@pytest.mark.parametrize("text", ["fast", "block,drop", "data,data-low", "block data", "data_high"])
def test_other_words_are_refused(text: str) -> None:
    """The error lists the words and gives an example."""
    with pytest.raises(InvalidQos, match="write for example drop,data-low"):
        parse_qos(text)
