"""rtspsrc over servers that go away, misbehave, come back, and come back different."""

import os
import re
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from itertools import islice, pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from streamkit import ElementFailure, Frame, FrameFlags, MessageKind, Pipeline, Pose
from streamkit_telemetry_formats.klv import KlvReader
from tests.waiting import next_state

StartServer = Callable[..., Any]
QUICK = "retry-delay-s=0.05 max-retry-delay-s=0.2"
READER = "reader"
MARGIN_S = 5.0  # for a machine under load; benchmarks/rtsp_faults.py measures how soon faults are noticed


def states(pipeline: Pipeline) -> list[str]:
    """The states of the connection posted so far."""
    found = []
    while (message := pipeline.bus.pop(0, (MessageKind.ELEMENT,))) is not None:
        found += [str(message.fields["state"])] if "state" in message.fields else []
    return found


def ended_by_finish(pipeline: Pipeline) -> bool:
    """Whether `finish` ends a pipeline with EOS."""
    pipeline.finish()
    ended = pipeline.wait(10)
    return ended is not None and ended.kind is MessageKind.EOS


def no_reader_is_left() -> bool:
    """Whether every thread that reads has ended."""
    return not [thread.name for thread in threading.enumerate() if thread.name.startswith(READER)]


def brightness(frame: Frame) -> int:
    """The number of the frame, from its brightness."""
    return round((float(frame.data.mean()) - 40) / 2)


def test_a_server_that_restarts_is_a_new_epoch(start_server: StartServer) -> None:
    """A killed server ends nothing: its return is a new epoch with a discontinuity, and times go on."""
    server = start_server()
    text = f"rtspsrc location={server.url} timeout-s=2 {QUICK} ! decode ! appsink name=out max-buffers=0"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = iter(pipeline["out"])
        seen = list(islice(frames, 10))
        for _ in range(2):
            server.close()
            next_state(pipeline, "retrying")
            server.open()
            seen += list(islice(frames, 12))
        assert states(pipeline)[-1] == "connected"
    assert [frame.epoch for frame in seen][-1] == 2
    assert all(a.pts < b.pts for a, b in pairwise(seen))
    assert all(a.seq < b.seq for a, b in pairwise(seen))
    firsts = [b for a, b in pairwise(seen) if a.epoch != b.epoch]
    assert all(frame.flags & FrameFlags.DISCONTINUITY for frame in firsts)
    assert no_reader_is_left()


def test_the_gap_between_epochs_is_real_time(start_server: StartServer) -> None:
    """Times over a reconnect contain its duration by the sender's clock."""
    server = start_server()
    text = f"rtspsrc location={server.url} {QUICK} ! appsink name=out max-buffers=0"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = iter(pipeline["out"])
        before = list(islice(frames, 20))[-1]
        server.close()
        pipeline.ended.wait(0.5)
        server.open()
        after = next(frame for frame in frames if frame.epoch == 1)
    assert after.pts - before.pts > 0.4e9
    assert abs((after.pts - before.pts) - (after.capture.utc_ns - before.capture.utc_ns)) < 1e9


def test_states_are_reported_in_order(start_server: StartServer) -> None:
    """Connecting, connected, then retrying with number, delay and reason, then given up."""
    server = start_server()
    text = f"rtspsrc location={server.url} max-retries=2 {QUICK} ! fakesink"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        next_state(pipeline, "connected")
        server.close()
        retry = next_state(pipeline, "retrying")
        assert retry.fields["attempt"] == 1
        assert "the server has closed the connection" in str(retry.fields["reason"])
        retry = next_state(pipeline, "retrying")
        assert retry.fields["attempt"] == 2
        assert "Connection refused" in str(retry.fields["reason"])
        assert next_state(pipeline, "gave-up").fields["attempt"] == 2
        error = pipeline.wait(5)
    assert error is not None
    assert error.text.endswith("gave up after 2 retries")
    assert no_reader_is_left()


MISBEHAVIOUR = {
    "accept and never answer": r"no video within 0\.4 s",
    "answer DESCRIBE, then be silent": r"no video within 0\.4 s",
    "answer PLAY, then send nothing": r"(no video within|has been silent for) 0\.4 s",
    "send ten frames and half of another, then nothing": r"has been silent for 0\.4 s",
    "answer with random bytes": r"Invalid data|no video within",
    "redirect to itself for ever": r"no video within 0\.4 s",
    "accept, then close": r"cannot be opened",
}


OVER_UDP = ("answer PLAY, then send nothing", "send ten frames and half of another, then nothing")


@pytest.mark.parametrize(
    ("behaviour", "transport"),
    [*((name, "tcp") for name in MISBEHAVIOUR), *((name, "udp") for name in OVER_UDP)],
)
def test_misbehaviour_is_noticed_in_time(start_server: StartServer, behaviour: str, transport: str) -> None:
    """Each kind ends in one clear error within timeout-s + 1 s; neither password nor thread stays."""
    server = start_server(behaviour)
    location = server.url.replace("//", "//me:hunter2@")
    source = f"rtspsrc location={location} timeout-s=0.4 reconnect=never transport={transport}"
    pipeline = Pipeline.parse(f"{source} ! appsink name=out max-buffers=0")
    began = last = time.monotonic()
    with pipeline:
        pipeline.play()
        with suppress(ElementFailure):
            for _ in pipeline["out"]:
                last = time.monotonic()
        noticed = time.monotonic()
        message = pipeline.wait(5)
    assert noticed - max(began, last) < 0.4 + MARGIN_S
    assert message is not None
    assert re.search(MISBEHAVIOUR[behaviour], message.text)
    assert "hunter2" not in message.text
    assert no_reader_is_left()


def test_a_stall_is_reported_and_overcome(start_server: StartServer, fake: ModuleType) -> None:
    """A server that stops sending is posted as stalled, and the next connection plays."""
    server = start_server("send ten frames and half of another, then nothing")
    text = f"rtspsrc location={server.url} timeout-s=0.5 {QUICK} ! appsink name=out max-buffers=0"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        next_state(pipeline, "connected")
        server.behaviour = fake.Behaviour.PLAY
        assert "has been silent for 0.5 s" in str(next_state(pipeline, "stalled").fields["reason"])
        next_state(pipeline, "connected")
        assert any(frame.epoch == 1 for frame in islice(pipeline["out"], 60))


def test_credentials(start_server: StartServer) -> None:
    """The right ones play, from the URL or the properties; wrong ones end at once, however often to retry."""
    server = start_server(user="me:hunter2")
    rest = "! appsink name=out max-buffers=0"
    for source in (
        f"location={server.url.replace('//', '//me:hunter2@')}",
        f"location={server.url} user-id=me user-pw=hunter2",
    ):
        with Pipeline.parse(f"rtspsrc {source} {rest}") as pipeline:
            pipeline.play()
            assert pipeline["out"].pull(5) is not None
    for source in (f"location={server.url.replace('//', '//me:nothunter@')}", f"location={server.url}"):
        pipeline = Pipeline.parse(f"rtspsrc name=r {source} reconnect=always {rest}")
        with pytest.raises(ElementFailure, match=r"asks for valid credentials: .*401") as caught:
            pipeline.run(timeout_s=5)
        assert "hunter" not in str(caught.value)
    element = Pipeline.parse(f"rtspsrc name=r location={server.url} user-pw=hunter2 {rest}")["r"]
    assert "hunter2" not in str(element.properties_set())


@pytest.mark.parametrize(
    ("policy", "behaviour", "epochs"),
    [
        ("never", "send ten frames, then say good-bye over RTCP and stay connected", 1),
        ("on-error", "send ten frames, then say good-bye over RTCP and stay connected", 1),
        ("always", "send ten frames, then say good-bye over RTCP and stay connected", 3),
        ("on-error", "send ten frames, then close", 3),
        ("never", "send ten frames, then close", 1),
    ],
)
def test_policies(start_server: StartServer, policy: str, behaviour: str, epochs: int) -> None:
    """A regular end is the end unless `always`; a closed connection is one to make again unless `never`."""
    server = start_server(behaviour)
    text = f"rtspsrc location={server.url} reconnect={policy} {QUICK} ! appsink name=out max-buffers=0"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = list(islice(pipeline["out"], 25))
    assert len({frame.epoch for frame in frames}) == epochs
    assert len(frames) == (25 if epochs > 1 else 10)


def test_always_waits_for_a_server_that_is_not_there_yet(start_server: StartServer) -> None:
    """With `always` a drone may be switched on after the pipeline."""
    server = start_server()
    server.close()
    text = f"rtspsrc location={server.url} reconnect=always {QUICK} ! appsink name=out max-buffers=0"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        next_state(pipeline, "retrying")
        next_state(pipeline, "retrying")
        server.open()
        assert pipeline["out"].pull(5) is not None


def test_size_may_change_on_reconnect(start_server: StartServer, fake: ModuleType) -> None:
    """A server that comes back with another size is decoded in that size."""
    server = start_server()
    text = f"rtspsrc location={server.url} {QUICK} ! decode ! appsink name=out max-buffers=0"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = iter(pipeline["out"])
        assert next(frames).data.shape == (48, 64)
        server.close()
        server.units = fake.access_units((96, 80), count=30)
        server.open()
        changed = next(frame for frame in frames if frame.epoch == 1)
    assert changed.data.shape == (80, 96)
    assert changed.caps["width"] == 96


def test_codec_and_rate_may_change_on_reconnect(start_server: StartServer, fake: ModuleType) -> None:
    """A server that comes back with H.265 at half the rate is decoded as that, with the times to match."""
    server = start_server()
    text = f"rtspsrc location={server.url} {QUICK} ! decode ! appsink name=out max-buffers=0"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = iter(pipeline["out"])
        assert next(frames).data.shape == (48, 64)
        server.close()
        server.units = fake.access_units((96, 80), count=30, codec="libx265")
        server.codec, server.rate = "h265", 15.0
        server.open()
        changed = list(islice((frame for frame in frames if frame.epoch == 1), 20))
    assert {frame.data.shape for frame in changed} == {(80, 96)}
    steps = sorted(b.pts - a.pts for a, b in pairwise(changed))
    assert steps[len(steps) // 2] == pytest.approx(1e9 / 15, rel=0.02)
    assert not any(frame.flags & FrameFlags.CORRUPT for frame in changed)


@pytest.mark.parametrize("transport", ["tcp", "udp"])
def test_capture_time_is_the_senders(start_server: StartServer, transport: str) -> None:
    """With sender reports each frame has the server's wall clock of its own frame, to the millisecond."""
    server = start_server(wall_clock_offset_s=-3600.0)
    text = f"rtspsrc location={server.url} transport={transport} ! decode ! appsink name=out max-buffers=0"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = list(islice(pipeline["out"], 40))
    assert {frame.capture.origin for frame in frames} == {"rtcp"}
    zeros = [frame.capture.utc_ns - brightness(frame) * 10**9 // 30 for frame in frames]
    # The brightness has a period of 2 s, and a busy machine may leave out more frames than that.
    offsets = [(zero - zeros[0] + 10**9) % (2 * 10**9) - 10**9 for zero in zeros]
    assert max(offsets) - min(offsets) < 2e6
    assert abs(time.time_ns() - 3600 * 10**9 - frames[-1].capture.utc_ns) < 2e9


def test_a_slow_consumer_sees_the_newest_and_all_are_counted(start_server: StartServer) -> None:
    """At 200 ms a frame its frames do not grow old, and delivered + dropped = received, exactly."""
    server = start_server()
    source = f"rtspsrc name=r location={server.url} reconnect=never"
    text = f"{source} ! decode name=d ! identity sleep-time=200000 ! appsink name=out max-buffers=0"
    ages = []
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        while (frame := pipeline["out"].pull(5)) is not None:
            ages.append(time.monotonic_ns() - frame.arrival_ns)
            if len(ages) == 15:
                server.close()
        received = pipeline["r"].received
        dropped = sum(pipeline["r"].drops.values()) + sum(pipeline["d"].drops.values())
        assert pipeline["d"].drops["late: a newer frame had come"] > 15
    assert received > 40
    assert len(ages) + dropped == received
    assert max(ages) < 1.5e9  # all of them would be 2.5 s late by now; benchmarks/rtsp_age.py measures it


@pytest.mark.parametrize("behaviour", [None, "accept, then close"])
def test_many_reconnects_leave_nothing_behind(start_server: StartServer, behaviour: str | None) -> None:
    """100 failing connections: neither descriptors nor threads grow (benchmarks/reconnects.py makes 1000)."""
    server = start_server(behaviour or "play")
    if behaviour is None:
        server.close()
    source = "reconnect=always max-retries=100 retry-delay-s=0 max-retry-delay-s=0 timeout-s=1"
    before = len(os.listdir("/proc/self/fd")), threading.active_count()
    with pytest.raises(ElementFailure, match="gave up after 100 retries"):
        Pipeline.parse(f"rtspsrc location={server.url} {source} ! fakesink").run(timeout_s=30)
    server.close()
    assert len(os.listdir("/proc/self/fd")) <= before[0]
    assert threading.active_count() <= before[1]


def test_two_sources_of_one_server_leave_each_other_alone(start_server: StartServer, tmp_path: Path) -> None:
    """Ending one connection to a server does not cut another to the same address."""
    server = start_server()
    text = f"rtspsrc location={server.url} reconnect=never ! appsink name=out max-buffers=0"
    with Pipeline.parse(text) as stays:
        stays.play()
        assert stays["out"].pull(5) is not None
        for _ in range(3):
            with Pipeline.parse(text) as goes:
                goes.play()
                assert goes["out"].pull(5) is not None
        assert len(list(islice(stays["out"], 10))) == 10
        assert stays.error is None


def test_telemetry_comes_beside_the_video(start_server: StartServer, streamkit_data: Path) -> None:
    """A server's KLV stream comes out of the pad `klv` with the video's times, and pairs with the frames."""
    data = (streamkit_data / "telemetry" / "Cheyenne.bin").read_bytes()
    klv = [packet.data for packet in KlvReader().feed(data)]
    server = start_server(telemetry=klv)
    source = f"rtspsrc name=s location={server.url}"
    text = f"{source}  s.src ! decode ! posesync name=p ! appsink name=out max-buffers=0  s.klv ! p.telemetry"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = list(islice(pipeline["out"], 60))
    poses = [frame.get(Pose) for frame in frames]
    assert sum(pose is not None for pose in poses) >= 58
    assert all(abs(pose.gap_ns) <= 34e6 for pose in poses if pose is not None)


@pytest.mark.parametrize("transport", ["tcp", "udp"])
def test_the_video_continues_after_lost_packets(
    start_server: StartServer, fake: ModuleType, transport: str
) -> None:
    """One RTP packet in 20 lost: frames come on, times ascend, damage is marked up to a keyframe."""
    server = start_server(units=fake.access_units((320, 240), count=60), loses_every=20)
    text = f"rtspsrc location={server.url} transport={transport} ! decode ! appsink name=out max-buffers=0"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = list(islice(pipeline["out"], 90))
    assert all(a.pts < b.pts for a, b in pairwise(frames))
    marked = [bool(frame.flags & FrameFlags.CORRUPT) for frame in frames]
    assert 10 < sum(marked) < 85
    assert all(
        now or not before
        for before, now, frame in zip(marked, marked[1:], frames[1:], strict=False)
        if not frame.flags & FrameFlags.KEYFRAME
    )


def test_a_stream_may_be_ended_while_its_server_is_away(start_server: StartServer, tmp_path: Path) -> None:
    """`finish` ends a source that waits for its next try, however long that is."""
    server = start_server()
    path = tmp_path / "flight.mp4"
    text = (
        f"rtspsrc location={server.url} retry-delay-s=600 max-retry-delay-s=600 ! packetsink location={path}"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        next_state(pipeline, "connected")
        server.close()
        next_state(pipeline, "retrying")
        assert ended_by_finish(pipeline)
    assert path.stat().st_size
    assert no_reader_is_left()


def test_a_stream_may_be_ended_before_it_has_begun(serve: Callable[[int], int]) -> None:
    """`finish` ends a source whose server says nothing, at once and without an error."""
    text = f"rtspsrc location=rtsp://127.0.0.1:{serve(1)}/live timeout-s=600 ! fakesink"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        next_state(pipeline, "connecting")
        assert ended_by_finish(pipeline)
