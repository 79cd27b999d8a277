from streamkit_media.decoding.marks import DAMAGE_LASTS, LOST_END_PACKETS, Damage


def test_damage_lasts_until_a_key_frame() -> None:
    """Frames after a damaged one are damaged too, up to the next keyframe."""
    damage = Damage()
    seen = []
    for is_corrupt, is_key in ((False, True), (True, False), (False, False), (False, True), (False, False)):
        seen.append(damage.next_frame(8, is_corrupt=is_corrupt, is_key=is_key))
    assert seen == [False, True, True, False, False]


def test_a_damaged_key_frame_heals_nothing() -> None:
    """Frames that depend on a damaged keyframe are damaged."""
    damage = Damage()
    damage.next_frame(8, is_corrupt=True, is_key=True)
    assert damage.next_frame(8, is_corrupt=False, is_key=False)


def test_a_packet_that_could_not_be_decoded_is_damage() -> None:
    """Later frames decode from wrong references."""
    damage = Damage()
    assert not damage.next_frame(8, is_corrupt=False, is_key=False)
    damage.begin(7, "frame 7")
    assert damage.next_frame(8, is_corrupt=False, is_key=False)


def test_streams_without_key_frames_heal_in_time() -> None:
    """Damage ends after a while where no keyframe ever comes."""
    damage = Damage()
    assert damage.next_frame(8, is_corrupt=True, is_key=False)
    for _ in range(DAMAGE_LASTS - 1):
        assert damage.next_frame(8, is_corrupt=False, is_key=False)
    assert not damage.next_frame(8, is_corrupt=False, is_key=False)


def test_packets_that_fail_up_to_the_end_are_counted() -> None:
    """With the first of them; a frame in between begins anew."""
    damage = Damage()
    damage.begin(7, "frame 7")
    damage.next_frame(8, is_corrupt=False, is_key=True)
    for number in range(8, 8 + LOST_END_PACKETS):
        assert damage.lost_end() == ""
        damage.begin(number, f"frame {number}")
    damage.next_frame(7, is_corrupt=False, is_key=False)  # was held for its order
    assert damage.lost_end().startswith(
        f"the last {LOST_END_PACKETS} packets gave no frame, from frame 8 on; "
    )
    damage.next_frame(99, is_corrupt=False, is_key=False)
    assert damage.lost_end() == ""
