from streamkit_media.decoding.freshness import WINDOW, InherentDelay

MS = 1_000_000


def test_frames_that_have_waited_are_reported() -> None:
    """A frame older than the youngest of late and the slack has waited, and it makes way for the newest."""
    gauge = InherentDelay()
    ages = (20, 119, 121, 20, 19, 500)
    assert [gauge.has_waited(age * MS, 100 * MS) for age in ages] == [False, False, True, True, False, True]


def test_a_delay_that_all_have_is_not_held_against_them() -> None:
    """Where every frame takes long, as with reordering codecs, all are shown after a moment."""
    gauge = InherentDelay()
    seen = [gauge.has_waited(400 * MS, 100 * MS) for _ in range(2 * WINDOW)]
    assert seen[:6] == [True, False] * 3
    assert not any(seen[WINDOW:])


def test_a_line_of_waiting_frames_makes_way_for_the_newest() -> None:
    """While each is younger than the one before, they are left out, down to one that has hardly waited."""
    gauge = InherentDelay()
    for _ in range(40):
        assert not gauge.has_waited(20 * MS, 100 * MS)
        line = [gauge.has_waited(age * MS, 100 * MS) for age in (220, 190, 160, 130, 100, 70, 40, 37)]
        assert line == [True] * 7 + [False]


def test_leaving_out_ends_where_it_does_not_help() -> None:
    """A frame that is no younger than the one left out before it is shown, however old."""
    gauge = InherentDelay()
    gauge.has_waited(20 * MS, 100 * MS)
    assert [gauge.has_waited(age * MS, 100 * MS) for age in (500, 480, 485)] == [True, True, False]


def test_what_is_known_to_be_late_holds_back_nothing() -> None:
    """The newest frame, after others that were left out for another reason, is shown."""
    gauge = InherentDelay()
    for age in (200, 170, 140, 110, 80):
        gauge.add(age * MS)
    assert not gauge.has_waited(50 * MS, 100 * MS)


def test_it_follows_a_delay_that_shrinks_at_once() -> None:
    """One young frame is enough to know that it can be quicker."""
    gauge = InherentDelay()
    for _ in range(2 * WINDOW):
        gauge.has_waited(400 * MS, 100 * MS)
    assert not gauge.has_waited(30 * MS, 100 * MS)
    assert gauge.has_waited(400 * MS, 100 * MS)
