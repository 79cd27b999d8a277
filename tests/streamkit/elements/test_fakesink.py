"""fakesink: takes frames and forgets them."""

import pytest

from streamkit import Caps, EndOfStream, Frame, MessageKind, Pipeline
from streamkit.testing import Harness


@pytest.mark.parametrize("count", [1, 3])
def test_an_end_after_a_number_of_frames(count: int) -> None:
    """fk-eos2: the last one wanted ends the stream, so that an endless source comes to EOS."""
    pipeline = Pipeline.parse(f"fakesrc ! queue ! fakesink name=s num-buffers={count}")
    pipeline.run(timeout_s=10)
    assert pipeline["s"].count == count


def test_none_wanted() -> None:
    """num-buffers=0: the first frame is refused, and so is every later one."""
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
        told = [dict(m.fields) for m in harness.messages if m.kind is MessageKind.ELEMENT]
    assert told == [{"name": "frame", "seq": 4, "pts": None, "caps": "a/b"}]
