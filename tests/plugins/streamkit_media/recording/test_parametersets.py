"""Parameter sets that FFmpeg's filters refuse: those that are harmless, and those that keep a muxer busy."""

from collections.abc import Callable
from pathlib import Path

import av
import pytest

from streamkit_media.nalunits import START_CODE, BadPacket, units
from streamkit_media.recording.parametersets import check_parameter_sets

# A count of reference frame sets is damaged: the muxer of Matroska reads this set for minutes.
ENDLESS_SET = bytes.fromhex(
    "42010101600000030090000003000003003ca00a080f16592a4980808080808032b9a02000000300200000030321"
)
VIDEO_SET, SEQUENCE_SET = 32, 33


@pytest.fixture
def keyframe(make_video: Callable[..., Path]) -> dict[int, bytes]:
    """The units of a packet of H.265 by their type."""
    with av.open(str(make_video("header.ts", codec="libx265"))) as container:
        return {unit[0] >> 1: unit for unit in units(bytes(next(container.demux(video=0))))}


def check(keyframe: dict[int, bytes]) -> None:
    """Checks a packet of these units."""
    check_parameter_sets("hevc", START_CODE.join([b"", *keyframe.values()]))


def test_a_harmless_set_passes(keyframe: dict[int, bytes]) -> None:
    """What breaks the rules and decodes."""
    odd = bytearray(keyframe[VIDEO_SET])
    odd[3] ^= 1  # the temporal nesting flag contradicts the number of sublayers
    check(keyframe | {VIDEO_SET: bytes(odd)})


def test_a_set_that_keeps_the_muxer_busy_is_refused(keyframe: dict[int, bytes]) -> None:
    """It does not decode either."""
    with pytest.raises(BadPacket, match="parameter sets are damaged"):
        check(keyframe | {SEQUENCE_SET: ENDLESS_SET})
