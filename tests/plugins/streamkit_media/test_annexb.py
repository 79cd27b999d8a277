import pytest

from streamkit_media.nalunits import AnnexBConverter, BadPacket

AVCC = bytes.fromhex("0142c00aff e1 0003 67aabb 01 0002 68cc".replace(" ", ""))
SETS = bytes.fromhex("00000001 67aabb 00000001 68cc".replace(" ", ""))


def test_lengths_become_start_codes() -> None:
    """Two units with lengths are two with start codes; a keyframe has the parameter sets before it."""
    writer = AnnexBConverter("h264", AVCC)
    data = bytes.fromhex("00000002 0901 00000003 658899".replace(" ", ""))
    plain = bytes.fromhex("00000001 0901 00000001 658899".replace(" ", ""))
    assert writer.packet(data, False) == plain
    assert writer.packet(data, True) == SETS + plain


def test_start_codes_pass() -> None:
    """Packets in Annex B stay as they are; sets that are within are not put there twice."""
    writer = AnnexBConverter("h264", SETS)
    bare = b"\0\0\0\1\x65\x88"
    assert writer.packet(bare, False) == bare
    assert writer.packet(bare, True) == SETS + bare
    assert writer.packet(SETS + bare, True) == SETS + bare


def test_other_codecs_pass() -> None:
    """VP9 and the like have neither."""
    assert AnnexBConverter("vp9", b"x").packet(b"abc", True) == b"abc"


@pytest.mark.parametrize("cut", range(1, len(AVCC)))
def test_damaged_headers_are_refused(cut: int) -> None:
    """A header cut anywhere is an error or holds fewer sets, never a crash."""
    try:
        writer = AnnexBConverter("h264", AVCC[:cut])
    except BadPacket:
        return
    assert writer.packet(b"\0\0\0\1\x65", False)


def test_damaged_packets_are_refused() -> None:
    """A unit that leads out of its packet is an error."""
    with pytest.raises(BadPacket, match="the length of a NAL unit exceeds its packet of 5 bytes"):
        AnnexBConverter("h264", AVCC).packet(b"\0\0\0\x09\x65", False)
