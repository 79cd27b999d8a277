"""tracksrc: what tracksink wrote comes back, line by line."""

from pathlib import Path

import pytest

from streamkit import ElementFailure, MessageKind, Pipeline
from tests.frames import frames_of

VIDEO = "videotestsrc num-buffers=12 ! video/x-raw, width=320, height=240, framerate=25/1"


def test_records_come_back_as_they_were_written(tmp_path: Path) -> None:
    """A copy made of them is the same file; frames have the times of their records."""
    path, copy = tmp_path / "tracks.jsonl", tmp_path / "copy.jsonl"
    Pipeline.parse(f"{VIDEO} ! tracksink location={path}").run(timeout_s=120)
    Pipeline.parse(f"tracksrc location={path} ! tracksink location={copy}").run(timeout_s=30)
    assert copy.read_bytes() == path.read_bytes()
    frames = frames_of(f"tracksrc location={path}")
    assert [frame.pts for frame in frames] == [number * 40_000_000 for number in range(12)]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "No such file or directory; name a file that tracksink wrote"),
        (b"\n{}\n", "tracks.jsonl:2: not a track record"),
        (b"\xff\xfe\n", "tracks.jsonl:1: not a track record"),
        (b"[" * 100_000, "tracks.jsonl:1: not a track record"),
    ],
)
def test_a_file_of_something_else_is_an_error_with_its_line(
    tmp_path: Path, content: bytes | None, message: str
) -> None:
    """Without a line of a record, nothing is guessed."""
    path = tmp_path / "tracks.jsonl"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ElementFailure, match=message):
        Pipeline.parse(f"tracksrc location={path} ! fakesink").run(timeout_s=30)


def test_a_half_written_last_line_is_left_out_with_a_warning(tmp_path: Path) -> None:
    """As a process that was killed leaves it."""
    path = tmp_path / "tracks.jsonl"
    Pipeline.parse(f"{VIDEO} ! tracksink location={path}").run(timeout_s=120)
    path.write_bytes(path.read_bytes()[:-20])
    warnings: list[str] = []
    with Pipeline.parse(f"tracksrc location={path} ! appsink name=out") as pipeline:
        pipeline.bus.watch(
            lambda message: warnings.append(message.text) if message.kind is MessageKind.WARNING else None
        )
        pipeline.play()
        assert len(list(pipeline["out"])) == 11
    assert ["half written" in text for text in warnings] == [True]
