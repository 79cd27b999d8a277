import os
import time
import wave
from collections.abc import Callable
from pathlib import Path

import av
import pytest

from streamkit import ResourceError, StreamError
from streamkit_media.container import check_file, display_orientation, open_container, video_stream
from streamkit_media.failures import open_failure


def test_a_good_file_opens(small_video: Path) -> None:
    """The best video stream of a good file is found."""
    with open_container(str(small_video)) as container:
        assert video_stream(container, "small").codec_context.name == "h264"


def test_a_file_url_opens(small_video: Path) -> None:
    """file:// URLs name files."""
    with open_container(small_video.as_uri()) as container:
        assert len(container.streams.video) == 1


def test_a_name_like_a_protocol_is_a_file(small_video: Path, tmp_path: Path) -> None:
    """A file's name is never taken for an FFmpeg protocol or pattern."""
    odd = tmp_path / "concat:a|b%03d.mp4"
    odd.write_bytes(small_video.read_bytes())
    with open_container(str(odd)) as container:
        assert len(container.streams.video) == 1


def test_a_missing_file_is_reported(tmp_path: Path) -> None:
    """The error says that there is no file, and where relative paths start."""
    with pytest.raises(ResourceError, match=r"none\.mp4: a file must be there, none is; check the path .*"):
        open_container(str(tmp_path / "none.mp4"))


def test_a_misspelt_file_is_answered_with_a_similar_one(tmp_path: Path) -> None:
    """Of the same folder, and not with any."""
    for name in ("flight.mp4", "tracks.jsonl"):
        (tmp_path / name).write_bytes(b"x")
    with pytest.raises(ResourceError, match=r'none is; did you mean "flight\.mp4"\?$'):
        check_file(str(tmp_path / "fligth.mp4"))
    with pytest.raises(ResourceError, match=r"none is; check the path"):
        check_file(str(tmp_path / "other.mkv"))


@pytest.mark.parametrize(
    "address", ["10.0.0.7:554/live", "camera.local:8554", "NAME:SECRET@10.0.0.7:554/live"]
)
def test_an_address_without_a_protocol_is_no_file(address: str) -> None:
    """The remedy says how the address of a camera begins; a time in a name is none."""
    with pytest.raises(ResourceError, match=r"or begin the address of a camera with rtsp://"):
        check_file(address)
    with pytest.raises(ResourceError, match=r"relative ones start at .*\)$"):
        check_file("flights/12:30/none.mp4")


def test_a_directory_is_reported(tmp_path: Path) -> None:
    """The error says that it is a directory and names the element for numbered frames."""
    with pytest.raises(ResourceError, match=r"a file is needed, this is a directory; .*multifilesrc"):
        open_container(str(tmp_path))


def test_a_pipe_is_refused_without_waiting(tmp_path: Path) -> None:
    """A named pipe, on which opening would wait for ever, is refused."""
    os.mkfifo(tmp_path / "pipe.mp4")
    rule = (
        "a regular file is needed, this is a pipe, socket or device; a pipe is not read; .*livesrc uri=udp:"
    )
    with pytest.raises(ResourceError, match=rule):
        open_container(str(tmp_path / "pipe.mp4"))
    with pytest.raises(
        ResourceError, match=r"-: a file is needed, this is the standard input; .*livesrc uri="
    ):
        check_file("-")


def box(name: bytes, size: int) -> bytes:
    """A box of an MP4 file, with content of that many bytes."""
    return (size + 8).to_bytes(4, "big") + name + bytes(size)


@pytest.mark.parametrize(
    ("content", "rule"),
    [
        (b"", r"the file is empty \(0 bytes\)"),
        (
            b"just some text\n" * 40,
            r"no media that FFmpeg can read: .* \(it begins with text: 'just some text",
        ),
        (b"\0" * 4096, r"no media that FFmpeg can read: .* \(it begins with zeros\)"),
        (box(b"ftyp", 16) + box(b"mdat", 900)[:500], r"its index \(the moov box\) is missing, .* untrunc"),
        (
            box(b"ftyp", 16) + (1).to_bytes(4, "big") + b"mdat" + (1 << 33).to_bytes(8, "big"),
            r"its index \(the moov box\) is missing",
        ),
        (
            box(b"ftyp", 16) + (1).to_bytes(4, "big") + b"mdat" + b"\xff" * 8,
            r"its index \(the moov box\) is missing",
        ),
        (box(b"ftyp", 16) + b"\0" * 8, r"its index \(the moov box\) is missing"),
        (bytes(range(256)) * 16, "no media that FFmpeg can read: .*; check that it is a whole video file"),
    ],
)
def test_files_without_media_are_reported(tmp_path: Path, content: bytes, rule: str) -> None:
    """A file without media gives one error that says what it holds instead."""
    path = tmp_path / "flight.mp4"
    path.write_bytes(content)
    with pytest.raises(StreamError, match=rule):
        open_container(str(path))


@pytest.mark.parametrize("name", ["notes.txt", "list.ffconcat"])
def test_text_is_never_video(tmp_path: Path, name: str) -> None:
    """FFmpeg would show text as video and follow lists of files; neither is wanted."""
    path = tmp_path / name
    path.write_text("ffconcat version 1.0\nfile /etc/hostname\n" * 30)
    with pytest.raises(StreamError, match=r"this is text or a list|no media that FFmpeg can read"):
        open_container(str(path))


def test_audio_alone_is_reported(tmp_path: Path) -> None:
    """A file without video gives an error that names the streams it has."""
    path = tmp_path / "sound.wav"
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(8000)
        file.writeframes(b"\1\2" * 800)
    with (
        open_container(str(path)) as container,
        pytest.raises(StreamError, match=r"sound\.wav: a video stream is needed, its streams are: audio"),
    ):
        video_stream(container, str(path))


def test_a_silent_server_is_reported_in_time(serve: Callable[[int], int]) -> None:
    """A server that accepts and says nothing ends in an error at the limit, without the password."""
    location = f"rtsp://me:secret@127.0.0.1:{serve(0)}/live"
    began = time.monotonic()
    with pytest.raises(
        ResourceError, match=r"rtsp://\*\*\*@127.*: no video within 0\.3 s: .*silent"
    ) as caught:
        open_container(location, {"rtsp_transport": "tcp"}, (0.3, 0.3))
    assert time.monotonic() - began < 0.3 + 5
    assert "secret" not in str(caught.value)


def test_a_video_of_which_nothing_decodes_is_not_rotated(small_video: Path, tmp_path: Path) -> None:
    """Packets of a data stream, and the empty ones at the end, are not decoded by the video."""
    cut = tmp_path / "cut.mov"
    with av.open(str(small_video)) as source, av.open(str(cut), "w") as output:
        stream = output.add_stream_from_template(source.streams.video[0])
        stream.metadata["timecode"] = "00:00:00:00"  # becomes a data stream
        packets = [packet for packet in source.demux(source.streams.video[0]) if packet.size]
        for packet in packets[1:5]:  # without their keyframe the decoder makes no frame of them
            packet.stream = stream
            output.mux(packet)
    with open_container(str(cut)) as container:
        assert [other.type for other in container.streams] == ["video", "data"]
        assert display_orientation(container, video_stream(container, "cut")) == {}


def test_a_server_that_fails_is_not_the_fault_of_the_address() -> None:
    """Its log says why; an address that is wrong is another error."""
    failed = av.error.HTTPServerError(0, "Server returned 5XX")
    assert str(open_failure("rtsp://a/b", failed, None)).endswith("; check the log of the server")
    missing = av.error.HTTPNotFoundError(0, "Server returned 404")
    assert str(open_failure("rtsp://a/b", missing, None)).endswith("; check address, port and path")
    silent = av.error.HTTPOtherClientError(0, "Server returned 4XX")
    assert str(open_failure("rtsp://a/b", silent, None)).endswith("and that it has video, not sound alone")


@pytest.mark.parametrize(
    ("location", "remedy"),
    [
        ("rstp://user:secret@a/b", 'did you mean "rtsp"?'),
        ("srt://a:9000", "livesrc receives SRT; write livesrc uri=srt://HOST:PORT"),
        ("gopher2://a/b", "write one of rtsp, rtsps, udp, tcp, rtmp, http, https, file"),
    ],
)
def test_a_protocol_that_is_not_there_gets_a_remedy(location: str, remedy: str) -> None:
    """Address, port and path have no part in it."""
    with pytest.raises(av.error.ProtocolNotFoundError) as caught:
        av.open(location)
    text = str(open_failure(location, caught.value, None))
    assert text.endswith(f": no such protocol; {remedy}")
    assert "secret" not in text
