from streamkit_media.decoding.marks import DAMAGE_LASTS, FrameMarks


def test_damage_lasts_until_a_key_frame() -> None:
    """Frames after a damaged one are damaged too, up to the next keyframe."""
    marks = FrameMarks()
    seen = []
    for is_corrupt, is_key in ((False, True), (True, False), (False, False), (False, True), (False, False)):
        seen.append(marks.next_frame(is_corrupt=is_corrupt, is_key=is_key))
    assert seen == [False, True, True, False, False]


def test_a_damaged_key_frame_heals_nothing() -> None:
    """Frames that depend on a damaged keyframe are damaged."""
    marks = FrameMarks()
    marks.next_frame(is_corrupt=True, is_key=True)
    assert marks.next_frame(is_corrupt=False, is_key=False)


def test_a_packet_that_could_not_be_decoded_is_damage() -> None:
    """Later frames decode from wrong references; a packet that no frame depends on does no harm."""
    marks = FrameMarks()
    marks.packet_dropped(is_discontinuity=False, is_damage=False)
    assert not marks.next_frame(is_corrupt=False, is_key=False)
    marks.packet_dropped(is_discontinuity=False, is_damage=True)
    assert marks.next_frame(is_corrupt=False, is_key=False)


def test_streams_without_key_frames_heal_in_time() -> None:
    """Damage ends after a while where no keyframe ever comes."""
    marks = FrameMarks()
    assert marks.next_frame(is_corrupt=True, is_key=False)
    for _ in range(DAMAGE_LASTS - 1):
        assert marks.next_frame(is_corrupt=False, is_key=False)
    assert not marks.next_frame(is_corrupt=False, is_key=False)


def test_a_discontinuity_is_reported_once_with_the_next_frame_shown() -> None:
    """A discontinuity on packets that are not shown moves to the next shown frame."""
    marks = FrameMarks()
    assert not marks.take_discontinuity()
    marks.packet_dropped(is_discontinuity=True, is_damage=False)
    marks.packet_dropped(is_discontinuity=False, is_damage=False)
    assert marks.take_discontinuity()
    assert not marks.take_discontinuity()
