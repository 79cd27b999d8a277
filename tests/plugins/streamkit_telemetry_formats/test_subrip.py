from hypothesis import given
from hypothesis import strategies as st

from streamkit_telemetry_formats.subrip import Cue, SubtitleReader


def cues_of(text: str) -> list[Cue]:
    """The subtitles with times of a text."""
    return [cue for cue in SubtitleReader().cues(text.split("\n")) if cue[0] is not None]


def test_cues() -> None:
    """Beginnings to the millisecond, several lines, Windows line ends, a file cut within its last cue."""
    text = "1\r\n00:00:01,000 --> 00:00:02,500\r\none\r\ntwo\r\n\r\n2\r\n01:00:00.040 --> 01:00:60,000\r\nthr"
    assert list(cues_of(text)) == [
        (1_000_000_000, "one\ntwo"),
        (3_600_040_000_000, "thr"),
    ]


def test_other_text_is_skipped() -> None:
    """Text before the first times, times without text at the end, and nonsense give nothing."""
    assert list(cues_of("hello\n\n00:00:01,000 -->\n\n7\n00:00:09,000 --> 00:00:10,000")) == []


@given(st.text(max_size=300))
def test_any_text_is_accepted(text: str) -> None:
    """No text raises."""
    assert all((cue[0] or 0) >= 0 for cue in cues_of(text))
