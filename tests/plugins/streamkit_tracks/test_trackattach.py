"""A finished run is drawn without a tracker."""

from pathlib import Path

import pytest

from streamkit import ElementFailure, Message, MessageKind, Pipeline, Tracks

RUN = "dronetestsrc num-buffers=20 seed=1 ! video/x-raw, width=320, height=240"
DROPPED = '"dropped":0'
TRACK = "particletrack window=100,80,40,40"


@pytest.mark.timeout(150)
def test_the_frames_have_the_tracks_of_the_run(tmp_path: Path) -> None:
    """Written again they are the same file; frames that the run left out have none."""
    path, again = tmp_path / "tracks.jsonl", tmp_path / "again.jsonl"
    options = "stamp=false provenance=false source=a"
    Pipeline.parse(f"{RUN} ! {TRACK} ! tracksink location={path} {options}").run(timeout_s=100)
    Pipeline.parse(f"{RUN} ! trackattach location={path} ! tracksink location={again} {options}").run(
        timeout_s=60
    )
    assert again.read_bytes() == path.read_bytes()
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[5:8] + lines[9:10]))
    with Pipeline.parse(f"{RUN} ! trackattach location={path} ! appsink name=out max-buffers=0") as pipeline:
        pipeline.play()
        assert [frame.seq for frame in pipeline["out"] if frame.tracks] == [5, 6, 7, 9]


def test_a_frame_has_the_record_of_its_time(tmp_path: Path) -> None:
    """A recording has other numbers and epochs than the live run, as has a run from the middle of a file."""
    path = tmp_path / "tracks.jsonl"
    times = {0: 39_000_000, 1: 80_400_000, 2: 120_000_000}  # of one there is no frame; rounded; exact
    line = '{{"schema":"streamkit.tracks/1","source":"a","seq":{},"epoch":{},"pts_ns":{},"tracks":[],{}}}\n'
    path.write_text("".join(line.format(seq, seq // 2, pts, DROPPED) for seq, pts in times.items()))
    source = "videotestsrc num-buffers=5 ! video/x-raw, framerate=25/1"
    with Pipeline.parse(
        f"{source} ! trackattach location={path} ! appsink name=out max-buffers=0"
    ) as pipeline:
        pipeline.play()
        assert [frame.seq for frame in pipeline["out"] if frame.get(Tracks) is not None] == [2, 3]
        warned = pipeline.bus.pop(0, (MessageKind.WARNING,))
    assert warned is not None
    assert "the first frame seq=2 pts=0.080 s that has a record has number 1 in it" in warned.text


def test_frames_of_another_size_are_an_error(tmp_path: Path) -> None:
    """The boxes of the tracks would be drawn at wrong places."""
    path = tmp_path / "tracks.jsonl"
    path.write_text(
        '{"schema":"streamkit.tracks/1","source":"a","seq":0,"epoch":0,"width":640,"height":480,"tracks":[],'
        '"dropped":0}\n'
    )
    source = "videotestsrc num-buffers=3 ! video/x-raw, width={}, height={}"
    with pytest.raises(
        ElementFailure, match=r"of frames of 640 x 480 px, this one has 320 x 240; give their"
    ):
        Pipeline.parse(f"{source.format(320, 240)} ! trackattach location={path} ! fakesink").run(
            timeout_s=30
        )
    Pipeline.parse(f"{source.format(640, 480)} ! trackattach location={path} ! fakesink").run(timeout_s=30)


def test_a_file_of_another_video_is_reported(tmp_path: Path) -> None:
    """No record fits; a missing file fails at the start."""
    path = tmp_path / "tracks.jsonl"
    path.write_text(
        '{"schema":"streamkit.tracks/1","source":"a","seq":900,"epoch":0,"tracks":[],"dropped":0}\n'
    )
    pipeline = Pipeline.parse(f"videotestsrc num-buffers=3 ! trackattach location={path} ! fakesink")
    warnings: list[str] = []
    pipeline.bus.watch(lambda message: warnings.append(message.text))
    pipeline.run(timeout_s=30)
    assert f"location={path}: no record has the time of a frame; name the file of its run" in warnings
    with pytest.raises(ElementFailure, match="No such file or directory; name a file that tracksink wrote"):
        Pipeline.parse("videotestsrc ! trackattach location=/none.jsonl ! fakesink").ready()
    with pytest.raises(ElementFailure, match="location must be set; write for example"):
        Pipeline.parse("videotestsrc ! trackattach ! fakesink").ready()


@pytest.mark.parametrize(
    ("element", "warning"),
    [
        ("videotestsrc num-buffers=1 ! trackattach run=1", "it has 2 runs, this is run 1; see run="),
        ("videotestsrc num-buffers=1 ! trackattach run=2", None),
        ("videotestsrc num-buffers=1 ! trackattach run=3", "no run 3, it has 2"),
        ("tracksrc run=2", None),
        ("tracksrc run=3", "no run 3, it has 2"),
    ],
)
def test_a_run_that_may_be_the_wrong_one_is_reported(
    tmp_path: Path, element: str, warning: str | None
) -> None:
    """An overlay of the first of two runs would pass for that of the newest."""
    path = tmp_path / "tracks.jsonl"
    line = '{"schema":"streamkit.tracks/1","source":"a","seq":0,"epoch":0,"tracks":[],"dropped":0}\n'
    path.write_text(2 * line)
    pipeline = Pipeline.parse(f"{element} location={path} ! fakesink")
    messages: list[Message] = []
    pipeline.bus.watch(messages.append)
    pipeline.run(timeout_s=30)
    warnings = [message.text for message in messages if message.kind is MessageKind.WARNING]
    assert warnings == ([] if warning is None else [f"location={path}: {warning}"])
