"""rtspsrc over a network that loses, swaps, holds back and cuts: never a hang, never damage unmarked."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from fractions import Fraction
from itertools import islice, pairwise
from types import ModuleType
from typing import Any

import av
import numpy as np
import pytest
from numpy.typing import NDArray

from streamkit import ElementFailure, Frame, FrameFlags, Pipeline
from tests.waiting import next_state

StartServer = Callable[..., Any]
SIZE = (320, 240)
RATE = 60
GOP = 15
MARGIN_S = 5.0  # for a machine under load; benchmarks/rtsp_faults.py measures how soon faults are noticed
QUICK = "retry-delay-s=0.05 max-retry-delay-s=0.2"
ALL = "latency=5000"  # a slow test machine must not drop frames


@pytest.fixture(scope="module")
def film() -> list[bytes]:
    """60 access units of a moving texture, a dozen RTP packets each, every 15th a keyframe."""
    chance = np.random.default_rng(7)
    coarse = chance.integers(40, 216, (SIZE[1] // 4 + 40, SIZE[0] // 4 + 40), dtype=np.uint8)
    texture = np.kron(coarse, np.ones((4, 4), np.uint8))
    encoder = av.CodecContext.create("libx264", "w")
    encoder.width, encoder.height, encoder.pix_fmt = *SIZE, "yuv420p"
    encoder.time_base, encoder.framerate = Fraction(1, RATE), Fraction(RATE)
    encoder.options = {"tune": "zerolatency", "preset": "ultrafast", "g": str(GOP), "bf": "0", "threads": "1"}
    units = []
    for index in range(60):
        pixels = np.full((SIZE[1] * 3 // 2, SIZE[0]), 128, np.uint8)
        pixels[: SIZE[1]] = texture[2 * index : 2 * index + SIZE[1], index : index + SIZE[0]]
        video_frame = av.VideoFrame.from_ndarray(pixels, "yuv420p")
        video_frame.pts = index
        units += [bytes(packet) for packet in encoder.encode(video_frame)]
    return units + [bytes(packet) for packet in encoder.encode(None)]


@pytest.fixture(scope="module")
def truth(film: list[bytes]) -> list[NDArray[np.uint8]]:
    """The film's frames as they decode where nothing is lost: uint8[240, 320]."""
    context = av.CodecContext.create("h264", "r")
    video_frames = [video_frame for unit in film for video_frame in context.decode(av.Packet(unit))]
    video_frames += context.decode(None)
    return [video_frame.to_ndarray()[: SIZE[1]] for video_frame in video_frames]


@pytest.fixture
def network(start_server: StartServer, proxy: ModuleType, film: list[bytes]) -> Iterator[Any]:
    """A bad network, still good, before a server that plays the film; `server` is the server."""
    with ExitStack() as stack:
        server = start_server(units=film, rate=RATE)
        found = stack.enter_context(proxy.LossyProxy(server.port))
        found.server = server
        yield found


def playing(network: Any, properties: str = ALL) -> Pipeline:
    """A pipeline that decodes what comes over the network."""
    source = f"rtspsrc name=r location={network.url} {properties}"
    return Pipeline.parse(f"{source} ! decode name=d ! appsink name=out max-buffers=0")


def is_marked(frame: Frame) -> bool:
    """Whether a frame is said to be damaged."""
    return bool(frame.flags & FrameFlags.CORRUPT)


def damage_unmarked(frames: list[Frame], truth: list[NDArray[np.uint8]]) -> list[int]:
    """The numbers of frames that are not as they were sent and do not say so."""
    found = []
    for frame in frames:
        number = round((frame.pts - frames[0].pts) * RATE / 1e9)
        if not is_marked(frame) and not np.array_equal(frame.data, truth[number % len(truth)]):
            found.append(number)
    return found


def healed(frames: Iterator[Frame], limit: int) -> list[Frame]:
    """Frames up to ten in a row without a mark, within a limit."""
    taken: list[Frame] = []
    for frame in islice(frames, limit):
        taken.append(frame)
        if len(taken) >= 10 and not any(is_marked(last) for last in taken[-10:]):
            return taken
    raise AssertionError(f"still damaged after {limit} frames")


@pytest.mark.parametrize("transport", ["tcp", "udp"])
@pytest.mark.parametrize("one_in", [11, 37])
def test_losses_are_marked_and_heal(
    network: Any, truth: list[NDArray[np.uint8]], transport: str, one_in: int
) -> None:
    """Each frame is as it was sent or marked as corrupt, and all is well again once the network is."""
    with playing(network, f"latency=300 transport={transport}") as pipeline:
        pipeline.play()
        frames = iter(pipeline["out"])
        seen = list(islice(frames, 10))
        assert not any(is_marked(frame) for frame in seen)
        network.loses_every = one_in
        seen += islice(frames, 60)
        network.loses_every = 0
        seen += healed(frames, 3 * GOP + 40)
        assert pipeline.error is None
    assert network.lost > 3
    assert sum(is_marked(frame) for frame in seen) > 10
    assert damage_unmarked(seen, truth) == []
    assert all(a.pts < b.pts for a, b in pairwise(seen))


def test_the_video_continues_after_changed_bytes(network: Any) -> None:
    """Packets with bytes changed, which no network lets through often, end nothing; then all is well."""
    network.damages_every = 7
    with playing(network) as pipeline:
        pipeline.play()
        frames = iter(pipeline["out"])
        list(islice(frames, 60))
        network.damages_every = 0
        healed(frames, 3 * GOP + 40)
        assert pipeline.error is None


def test_packets_out_of_order_do_no_harm(network: Any, truth: list[NDArray[np.uint8]]) -> None:
    """Over UDP a packet that comes after the next one is put in its place: no frame is damaged."""
    network.swaps_every = 5
    with playing(network, "latency=300 transport=udp") as pipeline:
        pipeline.play()
        seen = list(islice(pipeline["out"], 60))
    assert not any(is_marked(frame) for frame in seen)
    assert damage_unmarked(seen, truth) == []


def test_a_delay_drops_nothing(network: Any, truth: list[NDArray[np.uint8]]) -> None:
    """A network that is half a second slow gives every frame, whole."""
    network.delay_s = 0.5
    with playing(network) as pipeline:
        pipeline.play()
        seen = list(islice(pipeline["out"], 45))
        assert not pipeline["d"].drops
        assert not pipeline["r"].drops
    assert [frame.seq for frame in seen] == list(range(45))
    assert damage_unmarked(seen, truth) == []


def test_a_short_stall_is_waited_out(network: Any, truth: list[NDArray[np.uint8]]) -> None:
    """A pause of the network shorter than timeout-s costs no connection and, over TCP, no frame."""
    with playing(network, f"{ALL} timeout-s=5") as pipeline:
        pipeline.play()
        frames = iter(pipeline["out"])
        seen = list(islice(frames, 10))
        network.is_stalled = True
        pipeline.ended.wait(0.7)
        network.is_stalled = False
        seen += islice(frames, 40)
    assert {frame.epoch for frame in seen} == {0}
    assert [frame.seq for frame in seen] == list(range(50))
    assert damage_unmarked(seen, truth) == []
    assert network.server.connections == 1


@pytest.mark.parametrize("transport", ["tcp", "udp"])
def test_a_long_stall_is_reported_and_overcome(network: Any, transport: str) -> None:
    """Silence of timeout-s is posted as a stall; later the video continues as a new epoch."""
    with playing(network, f"{ALL} timeout-s=0.8 transport={transport} {QUICK}") as pipeline:
        pipeline.play()
        frames = iter(pipeline["out"])
        list(islice(frames, 10))
        network.is_stalled = True
        began = time.monotonic()
        reason = next_state(pipeline, "stalled").fields["reason"]
        assert time.monotonic() - began < 0.8 + MARGIN_S
        assert "has been silent for 0.8 s" in str(reason)
        network.is_stalled = False
        after = next(frame for frame in frames if frame.epoch)
        assert after.flags & FrameFlags.DISCONTINUITY
        assert after.flags & FrameFlags.KEYFRAME
        assert not is_marked(after)


def test_cuts_are_overcome(network: Any, truth: list[NDArray[np.uint8]]) -> None:
    """Connections that are cut amid a packet end in no damage unmarked, and each is followed by another."""
    with playing(network, f"{ALL} timeout-s=2 {QUICK}") as pipeline:
        pipeline.play()
        frames = iter(pipeline["out"])
        for epoch in range(4):
            first = next(frame for frame in frames if frame.epoch == epoch)
            seen = [first, *islice(frames, 8)]
            assert damage_unmarked(seen, truth) == []
            assert bool(first.flags & FrameFlags.DISCONTINUITY) == bool(epoch)
            network.cut()
        assert pipeline.error is None
    assert not [thread.name for thread in threading.enumerate() if thread.name.startswith("reader")]


@pytest.mark.parametrize("fault", ["blocks_udp", "refuses_udp"])
def test_auto_turns_to_tcp(network: Any, fault: str) -> None:
    """Where UDP brings nothing, or the server has none, `transport=auto` plays over TCP and says so."""
    setattr(network, fault, True)
    with playing(network, f"{ALL} timeout-s=2 transport=auto") as pipeline:
        pipeline.play()
        assert next(iter(pipeline["out"])).epoch == 0
        told = []
        while (message := pipeline.bus.pop(0)) is not None:
            told.append(str(message.fields.get("transport") or message.text))
    assert [word for word in told if word in ("udp", "tcp")] == ["udp", "tcp"]
    assert [text for text in told if "nothing came over UDP; continuing over TCP" in text]


def test_auto_stays_with_udp_where_that_works(network: Any) -> None:
    """With a good network `transport=auto` is UDP."""
    with playing(network, f"{ALL} transport=auto") as pipeline:
        pipeline.play()
        list(islice(pipeline["out"], 10))
        assert next_state(pipeline, "connecting").fields["transport"] == "udp"
        assert next_state(pipeline, "connected").fields["epoch"] == 0


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("blocks_udp", r"(no video within|has been silent for) 1 s"),
        ("refuses_udp", "does not send over the transport"),
    ],
)
def test_udp_alone_says_what_may_help(network: Any, fault: str, words: str) -> None:
    """Where UDP was asked for and brings nothing, the error is in time and names the other transport."""
    setattr(network, fault, True)
    began = time.monotonic()
    with pytest.raises(ElementFailure, match=f"{words}.*set transport=tcp or transport=auto"):
        playing(network, "timeout-s=1 transport=udp").run(timeout_s=10)
    assert time.monotonic() - began < 1 + MARGIN_S
