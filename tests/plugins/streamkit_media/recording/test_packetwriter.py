import subprocess
import sys
from pathlib import Path

import pytest

WRITE = """
import sys
from pathlib import Path
import av
from av.error import FFmpegError
from streamkit.output.file import OutputFile
from streamkit_media.codecs import video_caps
from streamkit_media.recording.formats import FORMATS
from streamkit_media.recording.packetwriter import PacketWriter
source, target = sys.argv[1:]
container = av.open(source)
stream = container.streams.video[0]
file = OutputFile(Path(target))
writer = PacketWriter(file, FORMATS[file.path.suffix], video_caps(stream))
for packet in container.demux(stream):
    if packet.size:
        try:
            writer.write_video(bytes(packet), packet.pts, packet.dts, None, packet.is_keyframe)
        except OSError as error:
            print("refused:", error.strerror)
writer.close()
"""


@pytest.mark.parametrize("ending", [".mp4", ".mov"])
def test_a_file_without_room_for_its_head_refuses_every_packet(
    small_video: Path, tmp_path: Path, ending: str
) -> None:
    """Where the head could not be written each packet is refused with the same reason; nothing crashes."""
    path = tmp_path / f"out{ending}"
    path.symlink_to("/dev/full")
    done = subprocess.run(
        [sys.executable, "-c", WRITE, str(small_video), str(path)],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["refused: No space left on device"] * 12
