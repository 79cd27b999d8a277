"""Tests of times that a container stores in order of coding."""

from streamkit_media.decoding.presentation_times import PresentationTimes


def _taken(times: PresentationTimes, frames: str) -> list[int | None]:
    """The times of frames in order of presentation: kind and number of the packet, such as I0 B2 P1."""
    return [
        times.take(int(frame[1:]), is_bidirectional=frame[0] == "B", is_key=frame[0] == "I")
        for frame in frames.split()
    ]


def _with_packets(*numbers: int) -> PresentationTimes:
    """Times of packets, each at its number, ns."""
    times = PresentationTimes()
    for number in numbers:
        times.add(number)
    return times


def test_the_first_reordered_frame_decides() -> None:
    """No frame has a wrong time before the mistake is found."""
    times = _with_packets(*range(5))
    assert _taken(times, "I0 B3 B2 B4 P1") == [0, 1, 2, 3, 4]
    assert times.are_wrong


def test_times_of_presentation_stay() -> None:
    """Packets in order of coding whose times do not ascend are right; packets without a frame leave gaps."""
    times = _with_packets(0, 4, 2, 1, 3)
    assert _taken(times, "I0 B2 B3 P4") == [0, 2, 3, 4]
    assert not times.are_wrong


def test_packets_without_reordering_leave_gaps() -> None:
    """A frame that is not bidirectional is not reordered: those before it are lost."""
    times = _with_packets(0, 1, 2, 3)
    assert _taken(times, "I0 P3") == [0, 3]
    assert not times.are_wrong


def test_a_keyframe_ends_the_effect_of_lost_frames() -> None:
    """Its own time is right, where frames before it have left times over."""
    times = _with_packets(*range(8))
    assert _taken(times, "I0 B2 P1 I5 B7 P6") == [0, 1, 2, 5, 6, 7]


def test_times_that_step_back_are_left_as_they_are() -> None:
    """As of a camera whose clock was set: nothing is said of the order of coding; a time may be missing."""
    times = _with_packets(5, 6, 2, 3)
    assert _taken(times, "I5 P6 P2 P3") == [5, 6, 2, 3]
    assert not times.are_wrong
    assert times.take(None, is_bidirectional=False, is_key=False) is None


def test_times_that_step_back_end_the_correction() -> None:
    """Behind the step they are those of another stream."""
    times = _with_packets(10, 11, 12, 13)
    assert _taken(times, "I10 B12 B13 P11") == [10, 11, 12, 13]
    for number in (3, 4):
        times.add(number)
    assert _taken(times, "I3 P4") == [3, 4]


def test_a_packet_that_gives_no_frame_is_left_out() -> None:
    """Its time is no other frame's."""
    times = _with_packets(*range(5))
    times.leave_out(3)
    times.leave_out(None)
    assert _taken(times, "I0 B2 P1 P4") == [0, 1, 2, 4]
