from streamkit_media.decoding.marks import WINDOW, InherentDelay

MS = 1_000_000


def test_frames_that_have_waited_are_reported() -> None:
    """A frame older than the inherent delay plus the slack has waited and is dropped."""
    delay = InherentDelay()
    ages = (20, 119, 121, 20, 19, 500)
    assert [delay.drops(age * MS, 100 * MS) for age in ages] == [False, False, True, True, False, True]


def test_a_delay_of_every_frame_is_accepted() -> None:
    """Where every frame is late, as with reordering codecs, all are shown after one window."""
    delay = InherentDelay()
    seen = [delay.drops(400 * MS, 100 * MS) for _ in range(2 * WINDOW)]
    assert seen[:6] == [True, False] * 3
    assert not any(seen[WINDOW:])


def test_a_queue_of_waiting_frames_is_dropped_down_to_the_newest() -> None:
    """Frames are dropped while each is younger than the one before, down to one that has hardly waited."""
    delay = InherentDelay()
    for _ in range(40):
        assert not delay.drops(20 * MS, 100 * MS)
        line = [delay.drops(age * MS, 100 * MS) for age in (220, 190, 160, 130, 100, 70, 40, 37)]
        assert line == [True] * 7 + [False]


def test_dropping_ends_where_it_does_not_help() -> None:
    """A frame that is not younger than the dropped one before it is shown, however old."""
    delay = InherentDelay()
    delay.drops(20 * MS, 100 * MS)
    assert [delay.drops(age * MS, 100 * MS) for age in (500, 480, 485)] == [True, True, False]


def test_frames_dropped_for_another_reason_delay_nothing() -> None:
    """The newest frame is shown after others that were dropped for another reason."""
    delay = InherentDelay()
    for age in (200, 170, 140, 110, 80):
        delay.add(age * MS)
    assert not delay.drops(50 * MS, 100 * MS)


def test_a_shrinking_delay_is_followed_at_once() -> None:
    """One young frame lowers the estimate."""
    delay = InherentDelay()
    for _ in range(2 * WINDOW):
        delay.drops(400 * MS, 100 * MS)
    assert not delay.drops(30 * MS, 100 * MS)
    assert delay.drops(400 * MS, 100 * MS)
