"""Which streams of a container are offered."""

from pathlib import Path

from streamkit_media.container import open_container
from streamkit_media.streams import StreamKind, kinds_of


def test_a_stream_of_an_unknown_codec_is_left_out(streamkit_data: Path, tmp_path: Path) -> None:
    """FFmpeg gives a subtitle stream without a codec no name; the video counts all the same."""
    (source,) = (streamkit_data / "odd_media").rglob("mse.webm")
    path = tmp_path / "unknown.webm"
    path.write_bytes(source.read_bytes().replace(b"D_WEBVTT/SUBTITLES", b"D_WEBVTZ/SUBTITLES"))
    with open_container(str(path)) as container:
        assert "subtitle" in {stream.type for stream in container.streams}
        assert StreamKind.VIDEO in kinds_of(container)
        assert StreamKind.SUBTITLE not in kinds_of(container)
