"""What a process may not do: take more memory than it was given, and with `sandbox` much else."""

import os
from pathlib import Path

import pytest

from streamkit import ElementFailure
from streamkit.flow.messages import Message
from streamkit.graph.pipeline import Pipeline
from streamkit.handoff.library_threads import thread_variables

LIMIT_S = 80.0
HELD = "read list write create remove rename truncate program shell fork signal privilege"


def attempts(home: str, secret: Path, more: str = "") -> dict[str, object]:
    """What the burglar in a bin could do, and what not."""
    text = f"fakesrc num-buffers=3 ! ( process=true {home} burglar secret={secret} {more} ) ! fakesink"
    with Pipeline.parse(text) as pipeline:
        messages: list[Message] = []
        pipeline.bus.watch(messages.append)
        pipeline.run(LIMIT_S)
    return dict(next(message.fields for message in messages if message.fields.get("name") == "attempts"))


@pytest.fixture
def secret(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file that no element has to do with."""
    file = tmp_path_factory.mktemp("private") / "secret"
    file.write_text("secret")
    return file


def test_the_sandbox_holds(secret: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No other files, no programs, no processes, no signals; threads and frames go on."""
    assert attempts("sandbox=true", secret, "replaces=true")["held"] == HELD
    assert secret.read_text() == "secret"
    assert [path.name for path in secret.parent.iterdir()] == ["secret"]


def test_without_a_sandbox_everything_is_open(secret: Path) -> None:
    """The test above is worth something: the same attempts succeed."""
    opened = str(attempts("", secret.parent / "missing")["opened"]).split()
    assert {"list", "write", "create", "remove", "shell", "fork", "signal"} <= set(opened)


def test_a_file_of_a_property_can_be_read_in_the_sandbox(tmp_path: Path) -> None:
    """A decoder of an untrusted file has what it needs: the file, its libraries, threads."""
    video = tmp_path / "video.mp4"
    Pipeline.parse(f"videotestsrc num-buffers=20 ! videofilesink location={video}").run(LIMIT_S)
    frames = []
    for sandbox in ("true", "false"):
        text = f"( process=true sandbox={sandbox} filesrc location={video} ! decode ) ! appsink name=out"
        with Pipeline.parse(text) as pipeline:
            pipeline.play()
            frames.append([frame.data.tobytes() for frame in pipeline["out"]])
    assert frames[0] == frames[1]
    assert frames[0]


def test_a_file_cannot_be_written_in_the_sandbox(tmp_path: Path) -> None:
    """The start says so; the kernel would refuse the first frame as if the folder had other rights."""
    file = tmp_path / "out.raw"
    text = f"fakesrc num-buffers=3 ! ( process=true sandbox=true filesink location={file} )"
    rule = f"location={file}: a bin with sandbox=true writes no file; put filesink0 outside"
    with Pipeline.parse(text) as pipeline, pytest.raises(ElementFailure, match=rule):
        pipeline.run(LIMIT_S)


def test_memory_is_limited() -> None:
    """An element that takes too much fails; the main process does not notice."""
    text = "fakesrc num-buffers=200 ! ( process=true memory-mb=1500 hungry ) ! fakesink"
    with Pipeline.parse(text) as pipeline, pytest.raises(ElementFailure, match=r"hungry0.*allocate"):
        pipeline.run(LIMIT_S)


def test_too_little_memory_to_begin_with_is_explained(capfd: pytest.CaptureFixture[str]) -> None:
    """The limit, and what Python with the elements has before the first frame; no traceback."""
    text = "fakesrc num-buffers=2 ! ( process=true name=b memory-mb=5 identity ) ! fakesink"
    with Pipeline.parse(text) as pipeline, pytest.raises(ElementFailure, match="process of b has ended"):
        pipeline.run(LIMIT_S)
    printed = capfd.readouterr().err
    assert "error: b: memory-mb=5: the process has " in printed
    assert "Traceback" not in printed


def test_a_child_gets_its_share_of_the_cores() -> None:
    """Its libraries start no more threads than there are cores for each of the processes."""
    text = "fakesrc is-live=true ! ( process=true identity ) ! ( process=true identity ) ! fakesink"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        _, *children = pipeline.process_statistics()
        for child in children:
            variables = Path(f"/proc/{child.pid}/environ").read_text().split("\0")
            for name, value in thread_variables(3).items():
                assert f"{name}={os.environ.get(name, value)}" in variables
