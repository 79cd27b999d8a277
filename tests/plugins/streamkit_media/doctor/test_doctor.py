import json
import re
import shlex
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import av
import pytest
from typer.testing import CliRunner

from streamkit import Caps, Frame, Pipeline
from streamkit.cli.main import make_app
from streamkit_media.doctor.checks import Report, Verdict, _decoding_check, _format_check, stream_checks
from streamkit_media.doctor.examine import examine, in_description
from streamkit_media.doctor.measure import Decoded
from streamkit_media.doctor.watch import Seen, watch
from streamkit_media.streams import DECODE_ONLY
from streamkit_telemetry_formats.klv import UAS_LOCAL_SET, checksum

BINARY = Path(sys.executable).with_name("streamkit")


def verdicts(report: Report) -> dict[str, str]:
    """The verdict of each check."""
    return {check.name: str(check.verdict) for check in report.checks}


def test_a_live_stream(fake: ModuleType) -> None:
    """A good server gets good verdicts, figures near the truth, and a line that builds, without secrets."""
    with fake.FakeServer(fake.access_units(), user="me:hunter2") as server:
        location = server.url.replace("//", "//me:hunter2@")
        steps: list[str] = []
        report = examine(location, seconds=2.0, timeout_s=3.0, transport="tcp", report_step=steps.append)
    where = server.url.replace("//", "//***@")
    assert steps == [f"connecting to {where}, 3 s at most", f"watching {where} for 2 s"]
    assert set(verdicts(report).values()) <= {"good", "note"}
    assert {
        "reach",
        "server",
        "stream",
        "decoding",
        "frame rate",
        "keyframes",
        "jitter",
        "clock",
        "loss",
        "telemetry",
    } == set(verdicts(report))
    facts = {check.name: check.facts for check in report.checks}
    assert facts["frame rate"]["measured"] == pytest.approx(30, rel=0.05)
    assert facts["keyframes"]["interval_s"] == pytest.approx(0.5, abs=0.05)
    assert facts["loss"]["missing"] == 0
    assert verdicts(report)["clock"] == "good"
    assert "hunter2" not in json.dumps(report.as_json())
    description = shlex.split(report.pipeline)[-1]
    assert Pipeline.parse(description, {"user": "a", "password": "b"})["s"].user_id == "a"


@pytest.mark.parametrize(("blocks_udp", "over", "suggested"), [(False, "UDP", "auto"), (True, "TCP", "tcp")])
def test_auto_names_the_transport_that_works(
    fake: ModuleType, monkeypatch: pytest.MonkeyPatch, blocks_udp: bool, over: str, suggested: str
) -> None:
    """The pipeline does not try UDP again where nothing came over it."""
    if blocks_udp:
        send = fake.Client.send
        monkeypatch.setattr(fake.Client, "send", lambda self, *packet: self.udp or send(self, *packet))
    with fake.FakeServer(fake.access_units()) as server:
        report = examine(server.url, seconds=0.5, timeout_s=2.0, transport="auto")
    (stream,) = (check for check in report.checks if check.name == "stream")
    assert stream.text.endswith(f" over {over}")
    assert f" transport={suggested} " in report.pipeline


def test_a_transport_that_is_none_is_refused() -> None:
    """The choices are those of rtspsrc."""
    done = CliRunner().invoke(make_app(), ["doctor", "rtsp://127.0.0.1:1/x", "--transport", "sctp"])
    assert done.exit_code == 2
    assert "'tcp', 'udp', 'auto'" in done.stderr
    done = CliRunner().invoke(make_app(), ["doctor", "rtsp://127.0.0.1:1/x", "--transport", "auto"])
    assert done.exit_code == 1
    assert "reach" in done.stdout


@pytest.mark.parametrize(
    ("behaviour", "name", "words"),
    [
        ("accept and never answer", "server", "does not answer"),
        ("accept, then close", "server", "closes it"),
        ("answer with random bytes", "server", "something else than RTSP"),
        ("answer PLAY, then send nothing", "stream", r"no video within|has been silent for"),
    ],
)
def test_bad_servers(fake: ModuleType, behaviour: str, name: str, words: str) -> None:
    """Each fault is the last check, bad, in words that name it; there is no pipeline."""
    with fake.FakeServer(fake.access_units(count=2), fake.Behaviour(behaviour)) as server:
        report = examine(server.url, seconds=1.0, timeout_s=0.6, transport="tcp")
    last = report.checks[-1]
    assert (last.name, last.verdict) == (name, Verdict.BAD)
    assert re.search(words, last.text)
    assert report.pipeline == ""


def test_a_file_that_is_cut_short(make_video: Callable[..., Path], tmp_path: Path) -> None:
    """What is there decodes, and the report says where it ends."""
    whole = make_video("long.mp4", count=150, container_options={"movflags": "faststart"})
    assert "length" not in verdicts(examine(str(whole), 1, 5, "tcp"))
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    report = examine(str(cut), 1, 5, "tcp")
    (length,) = (check for check in report.checks if check.name == "length")
    assert length.verdict is Verdict.NOTE
    assert re.fullmatch(r"the video ends at \d\.\d s of 6\.0 s: the file is cut short", length.text)


@pytest.mark.parametrize("name", ["long.mp4", "long.mkv", "long.avi"])
def test_a_long_file_that_is_cut_short(
    make_video: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Its end is looked at by itself."""
    monkeypatch.setattr("streamkit_media.doctor.examine.FILE_PACKETS", 60)
    codec = "mpeg4" if name.endswith("avi") else "libx264"
    whole = make_video(f"end_{name}", count=250, codec=codec, container_options={"movflags": "faststart"})
    assert "length" not in verdicts(examine(str(whole), 1, 5, "tcp"))
    cut = tmp_path / name
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    report = examine(str(cut), 1, 5, "tcp")
    (length,) = (check for check in report.checks if check.name == "length")
    assert re.fullmatch(r"the video ends (at|before) \d\.\d s of 10\.0 s: the file is cut short", length.text)


@pytest.mark.parametrize(
    ("packets", "frames", "interlaced", "verdict"),
    [
        (150, 84, 0, Verdict.NOTE),
        (150, 149, 0, Verdict.GOOD),  # a decoder may hold one back
        (150, 75, 75, Verdict.GOOD),  # two fields are a frame
        (150, 40, 40, Verdict.NOTE),
        (150, 130, 0, Verdict.GOOD),  # alternate references are not shown
        (9, 6, 0, Verdict.GOOD),
        (9, 3, 0, Verdict.NOTE),
    ],
)
def test_packets_without_frames_are_a_fault(
    packets: int, frames: int, interlaced: int, verdict: Verdict
) -> None:
    """A decoder that leaves out what it cannot decode reports no error; the number of frames does."""
    check = _decoding_check(Decoded(packets=packets, frames=frames, interlaced=interlaced), None)
    assert check.verdict is verdict
    assert check.text.startswith(f"{frames} frames of {packets} packets")


@pytest.mark.parametrize(
    ("name", "codec", "options"),
    [
        ("fields.ts", "libx264", {"x264-params": "interlaced=1:bframes=2"}),
        ("fields2.mpg", "mpeg2video", {"flags": "+ildct+ilme", "bf": "2"}),
        ("hidden.webm", "libvpx", {"auto-alt-ref": "1", "lag-in-frames": "25", "cpu-used": "0"}),
        ("hidden9.webm", "libvpx-vp9", {"auto-alt-ref": "1", "lag-in-frames": "25"}),
        ("delayed.mp4", "libx264", {"bf": "8", "x264-params": "b-adapt=0:b-pyramid=normal"}),
    ],
)
def test_whole_video_decodes_well(
    make_video: Callable[..., Path], name: str, codec: str, options: dict[str, str]
) -> None:
    """Fields, frames that are not shown, and deep reordering are no fault."""
    report = examine(str(make_video(name, count=60, codec=codec, options=options)), 1, 5, "tcp")
    assert verdicts(report)["decoding"] == "good", report.as_text()
    assert verdicts(report).get("fields") == ("note" if name.startswith("fields") else None)


def test_a_codec_without_a_media_type_is_named(make_video: Callable[..., Path]) -> None:
    """The caps of all of these are video/x-coded."""
    report = examine(str(make_video("lossless.mkv", codec="ffv1", pixel_format="yuv420p")), 1, 5, "tcp")
    assert "video/x-coded, codec=ffv1, " in report.as_text()


def test_a_file_with_telemetry(streamkit_data: Path) -> None:
    """Frames, rate and all 277 KLV packets are found, and the line pairs them."""
    report = examine(str(streamkit_data / "telemetry" / "sample-stream.ts"), 1, 5, "tcp")
    facts = {check.name: check.facts for check in report.checks}
    assert facts["frame rate"]["measured"] == pytest.approx(30, rel=0.01)
    assert (facts["telemetry"]["good_packets"], facts["telemetry"]["poses"]) == (277, 277)
    assert "s.klv ! p.telemetry" in report.pipeline
    assert "put hudmask areas=" in report.as_text().splitlines()[-1]


def test_what_does_not_decode_is_reported(make_video: Callable[..., Path], tmp_path: Path) -> None:
    """A file with readable packets of random bytes cannot be used, and no pipeline is suggested."""
    good = make_video("good.mkv")
    with av.open(str(good)) as container, av.open(str(tmp_path / "bad.mkv"), "w") as bad:
        stream = bad.add_stream_from_template(container.streams.video[0])
        for packet in container.demux(video=0):
            if packet.size:
                packet.update(b"\x7f" * packet.size)  # type: ignore[arg-type]
                packet.stream = stream
                bad.mux(packet)
    report = examine(str(tmp_path / "bad.mkv"), 1, 5, "tcp")
    assert verdicts(report)["decoding"] == "bad"
    assert "the video is damaged, encrypted or cut short" in report.as_text()
    assert not report.pipeline
    assert not report.is_usable


def test_a_file_without_a_key_frame(small_video: Path, tmp_path: Path) -> None:
    """It is reported, not counted as one."""
    cut = tmp_path / "cut.mkv"
    with av.open(str(small_video)) as container, av.open(str(cut), "w") as output:
        stream = output.add_stream_from_template(container.streams.video[0])
        for packet in container.demux(video=0):
            if packet.size and not packet.is_keyframe:
                packet.stream = stream
                output.mux(packet)
    report = examine(str(cut), 1, 5, "tcp")
    assert verdicts(report)["keyframes"] == "note"
    assert "keyframes   none in 8 packets" in report.as_text()


def test_a_url_without_a_file(tmp_path: Path) -> None:
    """Other URLs than rtsp:// are opened as such, and what is wrong is what FFmpeg says."""
    report = examine("http://me:hunter2@127.0.0.1:1/flight.mp4", 1, 2, "tcp")
    assert verdicts(report) == {"stream": "bad"}
    assert "cannot be opened" in report.as_text()
    assert "hunter2" not in report.as_text()


def test_telemetry_alone(streamkit_data: Path) -> None:
    """A file of telemetry without video is reported as such."""
    report = examine(str(streamkit_data / "telemetry" / "Cheyenne.bin"), 1, 5, "tcp")
    assert report.checks[-1].facts["positions"] == 407
    assert "posesync location=" in report.pipeline


def test_the_command(small_video: Path, tmp_path: Path) -> None:
    """--json prints the report; exit 0 where the stream can be used, 1 where not."""
    done = subprocess.run(
        [BINARY, "doctor", "--json", small_video], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, json.loads(done.stdout)["usable"]) == (0, True)
    done = subprocess.run(
        [BINARY, "doctor", tmp_path / "none.mp4"], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 1
    assert "a file must be there" in done.stdout


def test_frames_that_the_file_hides_are_not_counted(small_video: Path) -> None:
    """An edit list shows the later part of a file; frames before are decoded for it alone."""
    seen = Seen()
    packets = watch("filesrc", {"location": str(small_video)}, 20, None).kept
    for number, packet in enumerate(packets):
        seen.add_video(packet.attach(DECODE_ONLY) if number < 4 else packet)
    checks = {check.name: check for check in stream_checks(seen, is_live=False, transport="")}
    shown = len(packets) - 4
    assert checks["decoding"].text.startswith(f"{shown} frames of {len(packets)} packets, 4 more are hidden")
    assert checks["decoding"].verdict is Verdict.GOOD
    assert checks["loss"].text == f"none of {shown} frames is missing"


def test_other_videos_of_a_file_are_named(tmp_path: Path) -> None:
    """As a drone's thermal camera, or a transport stream's second program."""
    path = tmp_path / "two.mkv"
    with av.open(str(path), "w") as container:
        streams = [container.add_stream("mpeg4", rate=25, width=64, height=48) for _ in range(2)]
        for stream in streams:
            container.mux(stream.encode(av.VideoFrame(64, 48, "yuv420p")))
            container.mux(stream.encode(None))
    (found,) = (check for check in examine(str(path), 1, 5, "auto").checks if check.name == "videos")
    assert found.text == "one is looked at; video-stream=1 of the source reads another of [1]"


def test_the_size_of_a_stream_joined_between_keyframes_is_that_of_its_frames() -> None:
    """Its caps had none with the first packet."""
    seen = Seen()
    seen.add_video(Frame(b"", Caps("video/x-h264"), 0))
    assert _format_check(seen, "udp", (640, 480)).text == "video/x-h264, 640 x 480 over UDP"
    assert "size unknown" in _format_check(seen, "udp", None).text


def test_the_rotation_of_a_video_is_told() -> None:
    """Its frames have the other width and height."""
    seen = Seen()
    seen.add_video(Frame(b"", Caps("video/x-h264, width=640, height=480, rotation=90"), 0))
    text = "video/x-h264, 640 x 480, which decode rotates counter-clockwise by 90 degrees"
    assert _format_check(seen, "", None).text == text


def test_video_over_udp(two_klv_streams: Path) -> None:
    """What comes to a port is watched as other live video; the line has livesrc, and the telemetry."""
    data, done = two_klv_streams.read_bytes(), threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind(("127.0.0.1", 0))
        port = sender.getsockname()[1] ^ 1

        def send() -> None:
            while not done.wait(0.4):
                for at in range(0, len(data), 1316):
                    sender.sendto(data[at : at + 1316], ("127.0.0.1", port))

        thread = threading.Thread(target=send)
        thread.start()
        try:
            report = examine(f"udp://127.0.0.1:{port}", seconds=0.3, timeout_s=5.0, transport="tcp")
        finally:
            done.set()
            thread.join(10)
    assert verdicts(report)["stream"] == "good"
    assert "over UDP" in report.as_text()
    assert f"livesrc name=s uri=udp://127.0.0.1:{port} ! decode ! posesync name=p" in report.pipeline
    assert "s.klv_1 ! p.telemetry" in report.pipeline


def test_telemetry_in_the_second_stream(two_klv_streams: Path) -> None:
    """The stream with positions is named and put into the line."""
    report = examine(str(two_klv_streams), 1, 5, "tcp")
    assert "MISB KLV, pad klv_1: 12 packets, 12 with a position" in report.as_text()
    assert "s.klv_1 ! p.telemetry" in report.pipeline


def test_damaged_telemetry_alone(tmp_path: Path, klv_packet: Callable[..., bytes]) -> None:
    """Values that break their tag's rule are reported, and the others counted."""
    value = klv_packet(10.0, 10**15)[17:-4] + b"\x08\x81\x80" + b"\xff" * 128 + b"\x01\x02"
    data = UAS_LOCAL_SET + b"\x82" + (len(value) + 2).to_bytes(2, "big") + value
    path = tmp_path / "s.klv"
    path.write_bytes(data + checksum(data).to_bytes(2, "big"))
    report = examine(str(path), 1, 5, "tcp")
    check = report.checks[-1]
    assert (check.name, check.verdict, check.facts["positions"]) == ("telemetry", Verdict.NOTE, 1)
    assert "1 telemetry values left out" in check.text


def test_subtitles_without_positions(tmp_path: Path) -> None:
    """What posesync says of them."""
    path = tmp_path / "flight.srt"
    path.write_text("1\n00:00:00,000 --> 00:00:00,033\nFrameCnt: 1\n\n")
    report = examine(str(path), 1, 5, "tcp")
    assert verdicts(report) == {"file": "good", "stream": "bad"}
    assert "; nor telemetry: no position in it; it must hold MISB" in report.as_text()


def test_a_broken_video_is_not_taken_for_telemetry(tmp_path: Path) -> None:
    """By its name it is none, and what it lacks is said alone."""
    path = tmp_path / "flight.mp4"
    path.write_bytes(bytes(range(256)))
    (check,) = [check for check in examine(str(path), 1, 5, "tcp").checks if check.verdict is Verdict.BAD]
    assert check.text.endswith("check that it is a whole video file")


def test_a_photograph(streamkit_data: Path) -> None:
    """Its header has the position; a rate or a loss of one frame is not spoken of."""
    path = streamkit_data / "mosaic" / "brighton_beach" / "DJI_0020.JPG"
    report = examine(str(path), 1, 5, "tcp")
    assert verdicts(report) == {
        "file": "good", "stream": "good", "decoding": "good", "length": "note", "telemetry": "good",
    }  # fmt: skip
    assert report.checks[-1].facts == pytest.approx({"latitude": 46.84, "longitude": -91.996}, abs=0.01)
    assert f"location={path.parent}/DJI_%04d.JPG start-index=20 ! decode ! stitch" in report.pipeline


def test_a_photograph_that_is_cut_short(tmp_path: Path, streamkit_data: Path) -> None:
    """FFmpeg decodes it without an error."""
    data, path = (streamkit_data / "mosaic" / "aerial_cc0.jpg").read_bytes(), tmp_path / "cut.jpg"
    path.write_bytes(data[: len(data) // 2])
    (check,) = [check for check in examine(str(path), 1, 5, "tcp").checks if check.name == "length"]
    assert check.text == "the photograph is cut short, and part of it grey"


def test_photographs_by_number(streamkit_data: Path) -> None:
    """The first stands for all."""
    folder = streamkit_data / "mosaic" / "brighton_beach"
    report = examine(str(folder / "DJI_%04d.JPG"), 1, 5, "tcp")
    number = min(int(path.stem[4:]) for path in folder.glob("DJI_*.JPG"))
    assert f"multifilesrc location={folder}/DJI_%04d.JPG start-index={number} ! decode" in report.pipeline
    assert examine(str(folder / "none%d.jpg"), 1, 5, "tcp").checks[0].verdict is Verdict.BAD


def test_a_frame_without_a_number(streamkit_data: Path) -> None:
    """One image without a position gets a line that shows it, and no tracking."""
    report = examine(str(streamkit_data / "mosaic" / "aerial_cc0.jpg"), 1, 5, "tcp")
    assert verdicts(report)["telemetry"] == "note"
    assert report.pipeline.endswith('aerial_cc0.jpg ! decode ! fakesink"')


def test_a_video_of_one_frame_is_no_photograph(make_video: Callable[..., Path]) -> None:
    """Even with a number in its name it gets no line that counts on from it."""
    video = make_video("DJI_0420.mp4", count=1)
    assert examine(str(video), 1, 5, "tcp").pipeline.endswith('DJI_0420.mp4 ! decode ! fakesink"')


def test_a_bare_stream(streamkit_data: Path) -> None:
    """It has keyframes and no times."""
    path = streamkit_data / "odd_media" / "corpus" / "h264" / "MIDR_MW_D.264"
    checks = {check.name: check for check in examine(str(path), 1, 5, "tcp").checks}
    assert "no times" in checks["frame rate"].text
    assert checks["keyframes"].facts["seen"] == 2
    assert (checks["keyframes"].verdict, checks["loss"].facts) == (Verdict.GOOD, {})


def test_telemetry_beside_the_video(small_video: Path, streamkit_data: Path, tmp_path: Path) -> None:
    """The subtitle file of the same name is found and used."""
    video = tmp_path / "DJI_0001.mp4"
    video.write_bytes(small_video.read_bytes())
    good = streamkit_data / "telemetry" / "dji" / "mavic_pro.SRT"
    video.with_suffix(".SRT").write_bytes(good.read_bytes())
    report = examine(str(video), 1, 5, "tcp")
    assert verdicts(report)["telemetry"] == "good"
    assert f"posesync location={video.with_suffix('.SRT')} !" in report.pipeline


def test_a_silent_port_is_one_line(
    capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    """Neither PyAV's own traces nor warnings about our own properties, nor the error in the log, too."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
    report = examine(f"udp://127.0.0.1:{port}", 1, 0.3, "tcp")
    assert verdicts(report) == {"stream": "bad"}
    assert "no video within 0.3 s" in report.as_text()
    assert capfd.readouterr() == ("", "")
    assert caplog.messages == []


def test_times_in_order_of_coding_are_a_note(make_video: Callable[..., Path], tmp_path: Path) -> None:
    """A file of a writer that knows no B-frames can be used, and says what decode does about it."""
    right, wrong = make_video("right.mp4", count=30, bframes=3), tmp_path / "wrong.mp4"
    with av.open(str(right)) as container, av.open(str(wrong), "w") as output:
        source = container.streams.video[0]
        stream = output.add_stream_from_template(source)
        packets = [packet for packet in container.demux(source) if packet.size]
        for packet, pts in zip(packets, sorted(packet.pts or 0 for packet in packets), strict=True):
            packet.pts = packet.dts = pts
            packet.stream = stream
            output.mux(packet)
    assert "times" not in verdicts(examine(str(right), 1, 5, "tcp"))
    report = examine(str(wrong), 1, 5, "tcp")
    assert verdicts(report)["times"] == "note"
    assert report.is_usable


@pytest.mark.parametrize(
    "value", [r"back\slash", r"two\\s", 'a "q" b', r"f\"g", r"\$x", "$HOME", "`a`", "a!b;c (1) ü"]
)
def test_the_line_is_for_a_shell(value: str) -> None:
    """What a shell makes of it within double quotes is a description whose value is the name."""
    line = f'printf %s "location={in_description(value)}"'
    text = subprocess.run(["sh", "-c", line], capture_output=True, text=True, timeout=20, check=True).stdout
    assert Pipeline.parse(f"filesrc {text} ! fakesink")["filesrc0"].location == value
