"""fakesink: discards frames."""

import pytest

from streamkit import Caps, EndOfStream, Frame, MessageKind, Pipeline
from streamkit.testing import Harness


@pytest.mark.parametrize("count", [1, 3])
def test_num_buffers_ends_the_stream(count: int) -> None:
    """fk-eos2: an endless source ends."""
    pipeline = Pipeline.parse(f"fakesrc ! queue ! fakesink name=s num-buffers={count}")
    pipeline.run(timeout_s=10)
    assert pipeline["s"].count == count


def test_num_buffers_0_refuses_every_frame() -> None:
    """The first one and all later ones."""
    with Harness("fakesink", num_buffers=0) as harness:
        for _ in range(2):
            with pytest.raises(EndOfStream):
                harness.push(Frame(b"", Caps("a/b")))
        assert harness.element.count == 0  # type: ignore[attr-defined]


@pytest.mark.parametrize("kept", [True, False])
def test_the_last_frame_is_kept_where_wanted(kept: bool) -> None:
    """bs-last."""
    pipeline = Pipeline.parse(f"fakesrc num-buffers=3 ! fakesink name=s enable-last-sample={kept}")
    pipeline.run(timeout_s=10)
    last = pipeline["s"].last_frame
    assert (last.seq if last is not None else None) == (2 if kept else None)


def test_it_reports_frames_unless_silent() -> None:
    """A message for each frame."""
    with Harness("fakesink", silent=False) as harness:
        harness.push(Frame(b"", Caps("a/b"), seq=4))
        reported = [dict(m.fields) for m in harness.messages if m.kind is MessageKind.ELEMENT]
    assert reported == [{"name": "frame", "seq": 4, "pts": None, "caps": "a/b"}]
