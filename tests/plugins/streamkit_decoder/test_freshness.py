from streamkit_decoder.freshness import WINDOW, DelayGauge

MS = 1_000_000


def test_what_has_waited_is_told() -> None:
    """A picture older than the youngest of late and the slack has waited; the others have not."""
    gauge = DelayGauge()
    assert [gauge.has_waited(age * MS, 100 * MS) for age in (20, 119, 121, 20, 500)] == [
        False,
        False,
        True,
        False,
        True,
    ]


def test_a_delay_that_all_have_is_not_held_against_them() -> None:
    """Where every picture takes long, as with reordering codecs, they are shown after a moment."""
    gauge = DelayGauge()
    seen = [gauge.has_waited(400 * MS, 100 * MS) for _ in range(2 * WINDOW)]
    assert all(seen[: WINDOW - 1])
    assert not any(seen[WINDOW:])


def test_it_follows_a_delay_that_shrinks_at_once() -> None:
    """One young picture is enough to know that it can be quicker."""
    gauge = DelayGauge()
    for _ in range(2 * WINDOW):
        gauge.has_waited(400 * MS, 100 * MS)
    assert not gauge.has_waited(30 * MS, 100 * MS)
    assert gauge.has_waited(400 * MS, 100 * MS)
