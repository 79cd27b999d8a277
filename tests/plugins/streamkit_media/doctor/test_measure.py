import pytest

from streamkit_media.doctor.measure import PacketFacts, measure

STEP = 40_000_000


def packets(
    count: int = 100, gop: int = 25, late_ns: int = 0, missing: frozenset[int] = frozenset()
) -> list[PacketFacts]:
    """Frames at 25/s of 1000 bytes, every other one late."""
    return [
        PacketFacts(n * STEP, 7 + n * STEP + (late_ns if n % 2 else 0), 1000, n % gop == 0)
        for n in range(count)
        if n not in missing
    ]


def test_an_even_stream() -> None:
    """Rate, bit rate and keyframe interval are what they were made with; jitter and loss are none."""
    found = measure(packets())
    assert found.rate == pytest.approx(25)
    assert found.bit_rate == pytest.approx(25 * 8000, rel=0.02)
    assert found.keyframe_interval_s == pytest.approx(1.0)
    assert (found.jitter_ms, found.missing, found.is_variable) == (0, 0, False)


def test_jitter_is_that_of_rfc_3550() -> None:
    """Packets that come 10 ms late by turns have a jitter of 10 ms."""
    assert measure(packets(late_ns=10_000_000)).jitter_ms == pytest.approx(10, abs=0.1)


def test_missing_frames_are_counted() -> None:
    """Holes in the times are frames that did not come."""
    assert measure(packets(missing=frozenset({10, 50, 51}))).missing == 3


def test_a_variable_rate_has_no_missing_frames() -> None:
    """With varying distances a longer one does not count as a loss."""
    times = [0, 30, 100, 120, 200, 290, 300, 380]
    found = measure([PacketFacts(t * 1_000_000, t, 10, False) for t in times])
    assert found.is_variable
    assert found.missing == 0


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_packets_give_no_figures(count: int) -> None:
    """No packet or one: counts, and no figures."""
    found = measure(packets(count))
    assert found.packets == count
    assert (found.rate, found.jitter_ms, found.keyframe_interval_s) == (None, None, None)
