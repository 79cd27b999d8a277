"""Quality of service is written in words, and checked before anything is sent."""

import pytest
import zenoh

from streamkit_zenoh.publish.quality import InvalidQuality, Quality, quality


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", Quality(zenoh.CongestionControl.BLOCK, zenoh.Priority.DATA, False)),
        ("drop", Quality(zenoh.CongestionControl.DROP, zenoh.Priority.DATA, False)),
        ("express, real-time ,block", Quality(zenoh.CongestionControl.BLOCK, zenoh.Priority.REAL_TIME, True)),
        ("background,drop", Quality(zenoh.CongestionControl.DROP, zenoh.Priority.BACKGROUND, False)),
    ],
)
def test_words_are_read_in_any_order(text: str, expected: Quality) -> None:
    """What is not said is block and data."""
    assert quality(text) == expected


@pytest.mark.parametrize("text", ["fast", "block,drop", "data,data-low", "block data", "data_high"])
def test_other_words_are_refused(text: str) -> None:
    """The error lists the words and gives an example."""
    with pytest.raises(InvalidQuality, match="write for example drop,data-low"):
        quality(text)
