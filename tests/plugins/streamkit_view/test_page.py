"""What a person sees: the page in a real browser."""

from __future__ import annotations

import base64
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import av
import cv2
import msgspec
import numpy as np
import pytest
import zenoh
from selenium.webdriver import ActionChains, Chrome
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from streamkit import Frame, Pipeline, raw_video_caps
from streamkit_video import TrueTargets
from streamkit_zenoh.wire.frame_header import frame_header
from streamkit_zenoh.wire.images import ImageFormat, encode_image
from streamkit_zenoh.wire.messages import DropCount, ElementDrop, ElementStatus, StatusRecord
from streamkit_zenoh.wire.numbering import Stamp
from tests.slowness import patience

pytestmark = pytest.mark.long
STREAMKIT = str(Path(sys.executable).with_name("streamkit"))
SIZE = np.array([640, 360])
FLIGHT = "dronetestsrc num-buffers=100 seed=1 ! video/x-raw, format=BGR, width=640, height=360"
FRAME_NS = 40_000_000
YELLOW = (10, 214, 255)  # of confirmed targets, BGR
GREEN, RED = (0, 160, 0), (0, 0, 200)
TILE_PX = 4 * 32  # of a mosaic of 320 px, on the plane
LIVE = (
    "videotestsrc is-live=true pattern=ball ! video/x-raw, width=320, height=240, framerate={rate}/1 "
    "! tee name=t ! zenohsink name=z key={key}  t. ! encode gop=25 live=true ! z.video"
)
Flight = tuple[Path, dict[int, tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]]]
SCRIPT = "<img src=x onerror='window.hacked=1'><script>window.hacked=1</script>"


DRAWN = """
const { picture } = streamkit.screen;
const [width, height] = [picture.videoWidth ?? picture.width, picture.videoHeight ?? picture.height];
const canvas = Object.assign(document.createElement("canvas"), { width, height });
canvas.getContext("2d").drawImage(picture, 0, 0);
return canvas.toDataURL("image/png");
"""


def canvas(browser: Chrome, name: str) -> np.ndarray[Any, Any]:
    """The pixels of a canvas, or of the video, uint8[h, w, 4] BGRA."""
    of_canvas = f"return document.getElementById('{name}').toDataURL('image/png')"
    url = browser.execute_script(DRAWN if name == "video" else of_canvas)
    data = np.frombuffer(base64.b64decode(url.partition(",")[2]), np.uint8)
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED))


def text(browser: Chrome, name: str) -> str:
    """What is written in an element; "" where it is hidden."""
    return browser.find_element(By.ID, name).text


LONG_TEXT = """
const element = document.querySelector(arguments[0]);
for (let shown = element; shown; shown = shown.parentElement) shown.hidden = false;
element.textContent = "x".repeat(120);
return document.documentElement.scrollWidth;
"""


def set_screen(browser: Chrome, width: int, height: int, scale: int = 1) -> None:
    """The size of the window, px; a phone where the scale is 2."""
    metrics = {"width": width, "height": height, "deviceScaleFactor": scale, "mobile": scale > 1}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)


@contextmanager
def publisher(key: str) -> Iterator[subprocess.Popen[bytes]]:
    """A live publisher in a process of its own."""
    launch = [STREAMKIT, "launch", "-q", LIVE.format(key=key, rate=25)]
    process = subprocess.Popen(launch, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait(10)


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    """A file; the pixels of its frames by their number, and the centres of the cars."""
    path = tmp_path_factory.mktemp("flight") / "flight.mp4"
    text = f"{FLIGHT} ! tee name=t ! queue ! videofilesink location={path}  t. ! queue ! appsink name=out"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
        assert pipeline.wait(60), "the file is not complete"
    return path, {frame.seq: (np.asarray(frame.data), frame.get(TrueTargets).centres) for frame in frames}


@pytest.fixture(scope="module")
def tracks(flight: Flight) -> Path:
    """The records of a target of the flight; a server that plays them does not track."""
    path = flight[0].with_name("tracks.jsonl")
    track = f"decode ! particletrack window=100,80,40,40 ! tracksink location={path}"
    Pipeline.parse(f"filesrc location={flight[0]} ! {track}").run(timeout_s=patience(60))
    return path


def number_of_last(browser: Chrome) -> int | None:
    """The number of the frame that is shown with its own boxes, if it is the last one.

    A page that was too late for the flight's only keyframe, and says so, stays at an earlier one.
    """
    state = browser.execute_script(
        "const { shown, next, skipped } = streamkit.page;"
        "return shown && [shown.isExact && !next, shown.header.pts_ns, skipped > 0];"
    )
    if not state:  # no frame yet
        return None
    is_final, pts_ns, is_late = state
    number = int(pts_ns) // FRAME_NS
    return number if is_final and (number == 99 or is_late) else None


def last_frame(browser: Chrome) -> tuple[int, np.ndarray[Any, Any]] | None:
    """The number and the pixels of the last frame, unless another is shown meanwhile."""
    number = number_of_last(browser)
    if number is None:  # the pixels take the browser 50 ms
        return None
    pixels = canvas(browser, "video")[:, :, :3]
    return (number, pixels) if number_of_last(browser) == number else None


def drawn_boxes(overlay: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Centres of the boxes of confirmed targets, px of the overlay."""
    is_yellow = (np.abs(overlay[:, :, :3].astype(int) - YELLOW).max(2) < 30) & (overlay[:, :, 3] > 250)
    _, _, rows, _ = cv2.connectedComponentsWithStats(is_yellow.astype(np.uint8), connectivity=8)
    boxes = [row for row in rows[1:] if min(row[2], row[3]) >= 12 and row[4] < 0.7 * row[2] * row[3]]
    return np.array([(x + (width - 1) / 2, y + (height - 1) / 2) for x, y, width, height, _ in boxes])


@pytest.mark.timeout(180)
def test_a_file_is_shown_with_boxes_on_the_cars(
    browser: Chrome, start_view: Callable[..., Any], wait_for: Callable[..., Any], flight: Flight
) -> None:
    """The picture moves; at the end it is the file's last frame, with boxes within 4 px of the true cars."""
    path, truth = flight
    set_screen(browser, 1800, 1100)
    server = start_view(str(path))
    browser.get(server.url)
    wait_for(lambda: text(browser, "state") == "playing", 100)
    wait_for(lambda: browser.execute_script("return streamkit.page.video && streamkit.page.shown !== null"))
    first = canvas(browser, "video")
    assert first.shape[1::-1] == (*SIZE,)
    wait_for(lambda: np.abs(canvas(browser, "video").astype(int) - first).mean() > 2)
    wait_for(lambda: not browser.execute_script("return streamkit.page.asksStills"))
    wait_for(lambda: text(browser, "state") == "ended")
    number, shown = wait_for(lambda: last_frame(browser))
    pixels, cars = truth[number]
    assert np.abs(shown.astype(int) - pixels).mean() < 6
    overlay = canvas(browser, "overlay")
    stage = np.array(overlay.shape[1::-1])
    scale = (stage / SIZE).min()
    boxes = (drawn_boxes(overlay) - (stage - scale * SIZE) / 2) / scale
    inside, seen = (points[(points > 30).all(1) & (points < SIZE - 30).all(1)] for points in (boxes, cars))
    assert len(inside) >= len(seen) >= 4
    apart = np.linalg.norm(inside[:, None] - cars[None], axis=2).min(1)
    assert np.sort(apart)[int(0.8 * len(apart))] <= 4
    browser.find_element(By.CSS_SELECTOR, "#rows button").click()
    wait_for(lambda: "It is" in text(browser, "explain"))
    assert canvas(browser, "crops")[:, -60:, :3].std() > 5
    ground = browser.find_element(By.ID, "map")
    before = canvas(browser, "map")
    assert before[:, :, :3].std() > 20
    ground.send_keys(Keys.ARROW_RIGHT)
    wait_for(lambda: not np.array_equal(canvas(browser, "map"), before))
    ground.send_keys("0")
    wait_for(lambda: np.array_equal(canvas(browser, "map"), before))
    ActionChains(browser).move_to_element(ground).perform()
    wait_for(lambda: "plane" in text(browser, "cursor"))
    assert text(browser, "feeds") == "flight.mp4"
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []


@pytest.mark.timeout(180)
def test_the_past_of_an_ended_stream_plays_to_its_end(
    browser: Chrome,
    start_view: Callable[..., Any],
    wait_for: Callable[..., Any],
    flight: Flight,
    tracks: Path,
) -> None:
    """No frame is left out, though the states that the page gets meanwhile say that the stream has ended."""
    browser.get(start_view(str(tracks), "--video", str(flight[0])).url)
    wait_for(lambda: text(browser, "state") == "ended", 100)
    wait_for(lambda: number_of_last(browser))
    slider = browser.find_element(By.ID, "back")
    wait_for(lambda: slider.is_displayed() and int(slider.get_attribute("min")) <= -4)
    for _ in range(3):
        slider.send_keys(Keys.ARROW_LEFT)
    wait_for(lambda: browser.execute_script("return streamkit.page.shown?.header.pts_ns") is not None)
    wait_for(lambda: number_of_last(browser) == 99)
    assert browser.execute_script("return streamkit.page.skipped") == 0


@pytest.mark.timeout(180)
@pytest.mark.parametrize("missing", ["VideoDecoder", "MediaStreamTrackGenerator"])
def test_video_is_shown_in_a_canvas(
    browser: Chrome,
    start_view: Callable[..., Any],
    wait_for: Callable[..., Any],
    flight: Flight,
    tracks: Path,
    missing: str,
) -> None:
    """As over http from another machine, and in Firefox: a frame is that of its time, not one beside it."""
    path, truth = flight
    removal = {"source": f"delete window.{missing}"}
    script = browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", removal)
    try:
        browser.get(start_view(str(tracks), "--video", str(path)).url)
        wait_for(lambda: text(browser, "state") == "ended", 100)
        number, shown = wait_for(lambda: last_frame(browser))
    finally:
        browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)
    assert browser.execute_script(
        f"return streamkit.page.video && streamkit.screen.video.hidden && !window.{missing}"
    )
    apart = {at: np.abs(shown.astype(int) - pixels).mean() for at, (pixels, _) in truth.items()}
    assert min(apart, key=apart.__getitem__) == number
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []


@pytest.mark.timeout(180)
@pytest.mark.parametrize("orientation", [(90, False), (180, False), (270, True)])
def test_video_is_turned_for_display(
    browser: Chrome,
    start_view: Callable[..., Any],
    wait_for: Callable[..., Any],
    tmp_path: Path,
    orientation: tuple[int, bool],
) -> None:
    """The page shows the packets of a telephone's video as `decode` turns the frames."""
    video, records = tmp_path / "turned.mp4", tmp_path / "tracks.jsonl"
    image = np.full((240, 320, 3), 40, np.uint8)
    image[40:80, 60:180] = 220  # alike in no two of the orientations
    with av.open(str(video), "w") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 320, 240, "yuv420p"
        stream.set_display_rotation(*orientation)
        for _ in range(25):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, "bgr24")))
        container.mux(stream.encode(None))
    track = "decode ! video/x-raw, format=BGR ! tee name=t ! particletrack window=100,80,40,40"
    text = f"filesrc location={video} ! {track} ! tracksink location={records}  t. ! appsink name=out"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        expected = [np.asarray(frame.data) for frame in pipeline["out"]][-1]
        assert pipeline.wait(60), "the run is not complete"
    browser.get(start_view(str(records), "--video", str(video)).url)
    wait_for(lambda: browser.execute_script("return streamkit.page.video && streamkit.page.shown?.isExact"))
    shown = canvas(browser, "video")[:, :, :3]
    assert shown.shape == expected.shape
    assert np.abs(shown.astype(int) - expected).mean() < 6


@pytest.mark.timeout(180)
def test_a_finished_run_is_shown_with_its_video(
    browser: Chrome,
    start_view: Callable[..., Any],
    wait_for: Callable[..., Any],
    flight: Flight,
    tracks: Path,
) -> None:
    """The records of the file belong to the frames with their times; a page that opens late has them, too."""
    browser.get(start_view(str(tracks), "--video", str(flight[0])).url)
    wait_for(lambda: browser.execute_script("return streamkit.page.video && streamkit.page.shown?.isExact"))
    wait_for(lambda: text(browser, "state") == "ended")
    assert text(browser, "feeds") == "tracks.jsonl"
    shown = browser.execute_script("return streamkit.page.shown.record")
    (line,) = [line for line in tracks.read_text().splitlines() if json.loads(line)["seq"] == shown["seq"]]
    assert [track["x"] for track in json.loads(line)["tracks"]] == [track["x"] for track in shown["tracks"]]


def moving_stripes(number: int) -> np.ndarray[Any, Any]:
    """A frame of a test video, uint8[240, 320, 3]."""
    bright = (np.arange(320) + 4 * number) % 64 < 32
    return np.ascontiguousarray(np.broadcast_to(np.where(bright, 200, 40)[:, None], (240, 320, 3)), np.uint8)


@pytest.mark.timeout(120)
def test_a_video_that_browsers_do_not_decode_is_shown_in_images(
    browser: Chrome, start_view: Callable[..., Any], wait_for: Callable[..., Any], tmp_path: Path
) -> None:
    """MPEG-4 part 2 in an AVI: the picture is there, and moves."""
    path = tmp_path / "old.avi"
    with av.open(path, "w") as file:
        stream = file.add_stream("mpeg4", rate=25, width=320, height=240)
        for number in range(150):
            frame = av.VideoFrame.from_ndarray(moving_stripes(number), format="bgr24")
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
    browser.get(start_view(str(path)).url)
    wait_for(lambda: text(browser, "state") == "playing", 100)
    wait_for(lambda: canvas(browser, "video").shape[:2] == (240, 320))
    first = canvas(browser, "video")[:, :, :3].astype(int)
    assert first.std() > 20
    wait_for(lambda: np.abs(canvas(browser, "video")[:, :, :3] - first).mean() > 1)


@pytest.mark.timeout(180)
def test_a_camera_that_cannot_be_reached_is_shown_with_the_error(
    browser: Chrome, start_view: Callable[..., Any], wait_for: Callable[..., Any]
) -> None:
    """The pipeline's own line, in the red bar."""
    browser.get(start_view("rtsp://127.0.0.1:1/live").url)
    wait_for(lambda: text(browser, "state") not in ("", "connecting", "waiting"))
    assert text(browser, "state") == "lost"
    assert text(browser, "fault").startswith("error: rtspsrc0: rtsp://127.0.0.1:1/live: no connection")


@pytest.mark.timeout(180)
def test_loss_and_return_are_shown(
    browser: Chrome, start_view: Callable[..., Any], key: str, wait_for: Callable[..., Any]
) -> None:
    """A red bar says why, and goes away; also when the page's own server is gone."""
    server = start_view(key)
    browser.get(server.url)
    wait_for(lambda: text(browser, "state") == "waiting")
    with publisher(key):
        wait_for(lambda: text(browser, "state") == "playing")
        assert text(browser, "fault") == ""
        wait_for(lambda: browser.execute_script("return streamkit.page.video"))
    wait_for(lambda: "killed" in text(browser, "fault"))
    with publisher(key):
        wait_for(lambda: text(browser, "state") == "playing")
        assert text(browser, "fault") == ""
        shown = browser.execute_script("return streamkit.page.shown.header.published_ns")
        wait_for(
            lambda: browser.execute_script("return streamkit.page.shown.header.published_ns") > shown + 1e9
        )
        server.process.terminate()
        wait_for(lambda: "lost its connection" in text(browser, "fault"))
        assert server.process.wait(patience(20)) == 0


@pytest.mark.timeout(180)
def test_the_time_line_goes_back_and_returns(
    browser: Chrome, serve_keys: Callable[..., str], key: str, wait_for: Callable[..., Any]
) -> None:
    """The past plays on from its keyframe, with its own boxes; *Live* shows the newest frame again."""

    def shown_s() -> float:
        return float(browser.execute_script("return (streamkit.page.shown?.header.pts_ns ?? -1e9) / 1e9"))

    def newest_s() -> float:
        return float(browser.execute_script("return streamkit.page.states[0].status.seq")) / 25

    browser.get(serve_keys(key))
    slider = browser.find_element(By.ID, "back")
    with Pipeline.parse(LIVE.format(key=key, rate=25)) as pipeline:
        pipeline.play()
        wait_for(lambda: slider.is_displayed() and int(slider.get_attribute("min")) <= -4 and shown_s() > 0)
        for _ in range(3):
            slider.send_keys(Keys.ARROW_LEFT)
        # It stays so far back, however long the keys take.
        wait_for(
            lambda: text(browser, "back-text") == "0:03 ago" and shown_s() >= 0 and newest_s() - shown_s() > 2
        )
        past_s = shown_s()
        wait_for(lambda: shown_s() > past_s + 0.5)
        wait_for(lambda: browser.execute_script("return streamkit.page.shown?.isExact"))
        wait_for(lambda: newest_s() - shown_s() > 2)
        assert browser.find_element(By.ID, "state").text == "playing"
        browser.find_element(By.ID, "live").click()
        wait_for(lambda: text(browser, "back-text") == "live" and newest_s() - shown_s() < 1.5)


@pytest.mark.timeout(180)
def test_a_slow_page_says_how_many_frames_it_skipped(
    browser: Chrome, serve_keys: Callable[..., str], key: str, wait_for: Callable[..., Any]
) -> None:
    """One that takes ten packets a second of a hundred goes on at keyframes."""
    browser.get(serve_keys(key))
    with Pipeline.parse(LIVE.format(key=key, rate=100)) as pipeline:
        pipeline.play()
        wait_for(lambda: browser.execute_script("return streamkit.page.video"))
        browser.execute_script(
            "const { player } = streamkit; const push = player.push.bind(player);"
            "player.push = async (...packet) => {"
            "  await new Promise((done) => setTimeout(done, 100)); return push(...packet); };"
        )
        wait_for(lambda: "frames skipped by this page" in text(browser, "note"))
        wait_for(lambda: browser.execute_script("return streamkit.page.skipped") >= 10)


@pytest.mark.timeout(240)
def test_a_drawn_box_becomes_a_track_and_a_refused_value_is_told(
    browser: Chrome, serve_keys: Callable[..., str], key: str, wait_for: Callable[..., Any]
) -> None:
    """The box is drawn on the video; without the token the page offers no button."""
    url = serve_keys(key)
    launch = (
        "videotestsrc is-live=true pattern=smpte ! video/x-raw, width=320, height=240, framerate=10/1 "
        f"! particletrack name=tracker ! zenohsink key={key} control=true frame-rate=10"
    )
    set_screen(browser, 1280, 1100)
    with Pipeline.parse(launch) as pipeline:
        pipeline.play()
        browser.get(url.partition("?")[0])
        wait_for(lambda: "open the address" in text(browser, "answer"))
        assert not browser.find_element(By.ID, "draw").is_displayed()
        browser.get(url)
        button = wait_for(lambda: browser.find_element(By.ID, "draw"))
        wait_for(lambda: button.is_displayed() and browser.execute_script("return streamkit.page.shown"))
        button.click()
        video = browser.find_element(By.ID, "overlay")
        scale = min(video.size["width"] / 320, video.size["height"] / 240)
        box = ActionChains(browser).move_to_element_with_offset(video, round(-30 * scale), round(20 * scale))
        box.click_and_hold().move_by_offset(round(60 * scale), round(40 * scale)).release().perform()
        wait_for(lambda: "window is" in text(browser, "answer"))
        track = wait_for(lambda: browser.execute_script("return streamkit.page.newest.tracks[0]"))
        assert abs(track["x"] - 160) < 3
        assert abs(track["y"] - 160) < 3
        properties = browser.find_element(By.CSS_SELECTOR, "details[data-element=tracker]")
        # A click misses where the page moves meanwhile.
        wait_for(
            lambda: (
                properties.get_attribute("open") or properties.find_element(By.TAG_NAME, "summary").click()
            )
        )
        window = properties.find_element(By.TAG_NAME, "input")
        window.send_keys(Keys.CONTROL + "a" + Keys.NULL + "1,2\n")
        wait_for(lambda: "property window must be" in text(browser, "answer"))
        wait_for(lambda: window.get_attribute("value") == pipeline["tracker"].window)


@pytest.mark.timeout(120)
def test_stills_are_shown_without_coded_video(
    browser: Chrome, serve_keys: Callable[..., str], key: str, wait_for: Callable[..., Any]
) -> None:
    """The images of KEY/frame do where nothing else is published."""
    browser.get(serve_keys(key))
    description = f"videotestsrc is-live=true pattern=ball ! zenohsink key={key} frame-rate=10"
    with Pipeline.parse(description) as pipeline:
        pipeline.play()
        wait_for(lambda: "stills" in text(browser, "figures"))
        first = canvas(browser, "video")
        wait_for(lambda: not np.array_equal(canvas(browser, "video"), first))


@pytest.mark.timeout(120)
@pytest.mark.parametrize("rounded_ns", [0, -333_333, 333_333])
def test_a_record_that_comes_late_is_shown_with_its_frame(
    browser: Chrome, serve_keys: Callable[..., str], session: zenoh.Session, key: str,
    wait_for: Callable[..., Any], rounded_ns: int,
) -> None:  # fmt: skip
    """The last frame of a stream has its boxes, though its record needed longer than the frame is held.

    So has a frame whose time Matroska has rounded.
    """
    browser.get(serve_keys(key))
    image = np.full((240, 320, 3), 90, np.uint8)
    pts = written_record(5)["pts_ns"] + rounded_ns
    frame = Frame(image, raw_video_caps("BGR", 320, 240, None), pts=pts, seq=5)
    header = frame_header(frame, key, 1, 0, image.shape)
    images = session.declare_publisher(f"{key}/frame", encoding="image/jpeg;streamkit.frame/1")
    images.put(encode_image(image, ImageFormat.JPEG), attachment=Stamp(1, 0).attachment(header))
    wait_for(lambda: browser.execute_script("return streamkit.page.shown?.isExact === false"))
    session.put(
        f"{key}/tracks", json.dumps(written_record(5)), encoding="application/json;streamkit.tracks/1"
    )
    wait_for(lambda: browser.execute_script("return streamkit.page.shown?.isExact"))
    wait_for(lambda: len(drawn_boxes(canvas(browser, "overlay"))) == 1)


TOGETHER = """
const [count, done] = [...arguments];
const { page, player } = streamkit, image = new OffscreenCanvas(64, 48), shown = [];
image.getContext("2d");
for (let seq = 0; seq < count; seq += 1) {
  player.show(new VideoFrame(image, { timestamp: seq }), { epoch: 0, seq, pts_ns: seq * 4e7 });
}
const note = () => {
  shown.push(page.shown.header.seq);
  if (page.waiting.length) requestAnimationFrame(note);
  else done(shown);
};
requestAnimationFrame(note);
"""


@pytest.mark.timeout(120)
@pytest.mark.parametrize(("count", "shown"), [(2, [0, 1]), (5, [3, 4])])
def test_frames_that_come_within_one_refresh_are_shown_one_after_the_other(
    browser: Chrome,
    serve_keys: Callable[..., str],
    key: str,
    wait_for: Callable[..., Any],
    count: int,
    shown: list[int],
) -> None:
    """Records of two frames often come together; of more the newest two are shown, so that none lags."""
    browser.get(serve_keys(key))
    wait_for(lambda: browser.execute_script("return streamkit.page.isOnline"))  # a new connection clears it
    assert browser.execute_async_script(TOGETHER, count) == shown


FIT = """
const [points, asked, done] = [...arguments];
import("./geo.js").then(({ GeoFit }) => {
  const fit = new GeoFit();
  fit.note(points.map(([x, y, lat, lon]) => ({ point: [x, y], lat, lon, error: 3 })));
  done([fit.locate(asked), fit.length([10, 0])]);
});
"""


@pytest.mark.timeout(120)
def test_coordinates_follow_from_those_of_targets_and_only_where_these_suffice(
    browser: Chrome, serve_keys: Callable[..., str], key: str
) -> None:
    """A plane of 0.1 m per pixel, north up; targets on one line say nothing of what lies beside it."""
    browser.get(serve_keys(key))
    numbers = np.random.default_rng(1)
    plane = numbers.uniform(0, 1000, (20, 2))

    def located(points: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        latitudes = 47 - points[:, 1] * 0.1 / 111_320
        longitudes = 8 + points[:, 0] * 0.1 / (111_320 * np.cos(np.radians(47)))
        return np.column_stack([points, latitudes, longitudes])

    asked = np.array([[2000.0, 500.0]])
    found, metres = browser.execute_async_script(FIT, located(plane).tolist(), asked[0].tolist())
    _, _, latitude, longitude = located(asked)[0]
    assert found["lat"] == pytest.approx(latitude, abs=1e-6)
    assert found["lon"] == pytest.approx(longitude, abs=1e-6)
    assert found["error"] == pytest.approx(3, abs=0.1)
    assert metres == pytest.approx(1, abs=1e-3)
    plane[:, 1] = plane[:, 0]
    assert browser.execute_async_script(FIT, located(plane).tolist(), asked[0].tolist()) == [None, None]
    few = located(plane[:5]).tolist()
    assert browser.execute_async_script(FIT, few, asked[0].tolist())[0] is None


@pytest.mark.timeout(120)
def test_text_from_the_network_stays_text(
    browser: Chrome,
    serve_keys: Callable[..., str],
    session: zenoh.Session,
    key: str,
    wait_for: Callable[..., Any],
) -> None:
    """A status with markup in its strings is shown letter by letter, and runs nothing."""
    browser.get(serve_keys(key))
    status = StatusRecord(
        schema="streamkit.status/1", source=SCRIPT, state="playing", run=1, published_ns=1, uptime_s=1.0,
        frames=1, tracks=0, streams=(), drops=(DropCount(stream=SCRIPT, reason=SCRIPT, count=7),),
        elements=(ElementStatus(name=SCRIPT, busy_ns=1, drops=(ElementDrop(reason=SCRIPT, count=8),)),),
    )  # fmt: skip
    publishing = session.declare_publisher(f"{key}/status", encoding="application/json;streamkit.status/1")

    def is_shown() -> bool:
        publishing.put(msgspec.json.encode(status))
        return text(browser, "figures").count(f"dropped: {SCRIPT}, {SCRIPT}") == 2

    wait_for(is_shown)
    assert browser.execute_script("return window.hacked === undefined")
    assert not browser.find_elements(By.CSS_SELECTOR, "dl img, dl script")
    session.put(f"{key}/tracks", b"{")
    wait_for(lambda: "invalid\ntracks 1" in text(browser, "figures"))


@pytest.mark.timeout(120)
def test_a_late_page_gets_the_whole_mosaic(
    browser: Chrome, serve_keys: Callable[..., str], session: zenoh.Session, key: str,
    publish_mosaic: Callable[[np.ndarray[Any, Any]], None], wait_for: Callable[..., Any],
) -> None:  # fmt: skip
    """And the tile that has changed since; a page that is there gets that tile alone."""
    browser.get(serve_keys(key))
    records = session.declare_publisher(f"{key}/tracks", encoding="application/json;streamkit.tracks/1")
    image = np.zeros((320, 320, 3), np.uint8)
    image[0:96, 0:160] = GREEN

    def shows(green: int, red: int) -> bool:
        records.put(json.dumps(written_record(1)).encode())
        shown = browser.execute_script("return streamkit.mosaic.shown?.taken.size ?? 0")
        if not shown or not browser.find_element(By.ID, "map").is_displayed():
            return False
        pixels = canvas(browser, "map")[:, :, :3].astype(int)
        areas = [int((np.abs(pixels - colour).max(2) < 12).sum()) for colour in (GREEN, RED)]
        tile_px = (TILE_PX * browser.execute_script("return streamkit.map.view.scale")) ** 2
        return [round(area / tile_px) for area in areas] == [green, red]

    publish_mosaic(image)
    wait_for(lambda: shows(15, 0))
    taken = browser.execute_script("return streamkit.mosaic.shown.version")
    image[96:128, 160:192] = RED
    publish_mosaic(image)
    wait_for(lambda: shows(15, 1))
    assert browser.execute_script("return streamkit.mosaic.shown.version") == taken + 1
    browser.refresh()
    wait_for(lambda: shows(15, 1))


@pytest.mark.timeout(120)
def test_a_map_out_of_sight_is_not_drawn(
    browser: Chrome, serve_keys: Callable[..., str], session: zenoh.Session, key: str,
    wait_for: Callable[..., Any],
) -> None:  # fmt: skip
    """It is there to be scrolled to, and is then drawn without another record."""
    set_screen(browser, 390, 200)
    browser.get(serve_keys(key))
    record = json.dumps(written_record(1)).encode()
    encoding = "application/json;streamkit.tracks/1"

    def has_section() -> bool:
        session.put(f"{key}/tracks", record, encoding=encoding)
        return browser.find_element(By.ID, "ground").is_displayed()

    wait_for(has_section)
    view = "return new Promise((done) => requestAnimationFrame(() => done(streamkit.map.view)))"
    assert browser.execute_script(view) is None
    browser.execute_script("document.getElementById('map').scrollIntoView()")
    wait_for(lambda: browser.execute_script(view) is not None)


HELD = """
const [waited, silent, done] = [...arguments];
import("./player.js").then(({ Player }) => {
  const player = new Player({});
  player.recordCame(0, 100);
  player.newest.at -= silent;
  done(!player.isDue({ header: { epoch: 0, pts_ns: 200 }, at: performance.now() - waited }));
});
"""


@pytest.mark.timeout(120)
@pytest.mark.parametrize(
    ("waited_ms", "silent_ms", "is_held"), [(3000, 1000, True), (3000, 2000, False), (6000, 0, False)]
)
def test_a_packet_waits_for_its_record_while_records_come(
    browser: Chrome, serve_keys: Callable[..., str], key: str, waited_ms: int, silent_ms: int, is_held: bool
) -> None:
    """A slow pipeline's boxes are seen, too; but the video is at most five seconds late."""
    browser.get(serve_keys(key))
    assert browser.execute_async_script(HELD, waited_ms, silent_ms) == is_held


DAMAGED = """
const [pattern, done] = [...arguments];
window.VideoDecoder = class {
  static isConfigSupported = async () => ({ supported: true });
  constructor(calls) { Object.assign(this, calls, { state: "unconfigured", decodeQueueSize: 0 }); }
  configure() { this.state = "configured"; }
  close() { this.state = "closed"; }
  decode({ timestamp }) {
    if (pattern[timestamp / 1000] === "x") this.error(new Error("damaged"));
    else this.output({ timestamp, close() {} });
  }
};
import("./player.js?with-damage").then(async ({ Player }) => {
  const shown = [];
  const show = (frame, header) => shown.push(header.seq);
  const player = new Player({ show, cannot: () => shown.push("stills") });
  for (let number = 0; number < pattern.length; number += 1) {
    const header = { epoch: 0, seq: number, pts_ns: number * 1e6, keyframe: true, codec: "avc1.640028" };
    await player.push(header, { run: 1, number }, new Uint8Array(4));
  }
  done(shown);
});
"""


@pytest.mark.timeout(120)
@pytest.mark.parametrize(
    ("pattern", "shown"),
    [(".x" * 5 + ".", [0, 2, 4, 6, 8, 10]), (".xxx..", [0, "stills"])],
    ids=["now and then", "three in a row"],
)
def test_damaged_packets_end_the_video_only_where_nothing_is_decoded_between_them(
    browser: Chrome, serve_keys: Callable[..., str], key: str, pattern: str, shown: list[int | str]
) -> None:
    """A camera's network loses packets all day; a browser that decodes none of three shows stills."""
    browser.get(serve_keys(key))
    assert browser.execute_async_script(DAMAGED, pattern) == shown


TRAIL = """
const [records, done] = [...arguments];
import("./trails.js").then(({ Trails }) => {
  const trails = new Trails();
  records.forEach((record) => trails.note(record));
  done(trails.onPlane(1));
});
"""


@pytest.mark.timeout(120)
def test_a_trail_covers_75_records_with_every_third_place_and_the_newest(
    browser: Chrome, serve_keys: Callable[..., str], key: str
) -> None:
    """Few points are drawn; the trail begins at the target all the same."""
    browser.get(serve_keys(key))
    records = [written_record(number) for number in range(101)]
    for number, record in enumerate(records):
        record["tracks"][0]["x"] = number
    places = [x for x, _ in browser.execute_async_script(TRAIL, records)]
    assert places[-1] == 100
    assert len(places) == 25
    assert set(np.diff(places[:-1])) == {3}


def written_record(number: int) -> dict[str, Any]:
    """A record with a target, markup in its texts, at five a second."""
    box = [140, 110, 180, 130]
    detection = {"row": 0, "centroid": [160, 120], "bbox": box, "area": 800, "score": 1, "label": SCRIPT}
    provenance = {"predicted": [160, 121], "detection": detection, "similarity": 0.9, "cause": SCRIPT}
    track = {
        "id": 1, "state": "confirmed", "x": 160, "y": 120, "length": 40, "width": 20, "angle": 0.1, "vx": 3,
        "vy": 4, "bbox": box, "score": 0.9, "age_ns": 10**9 * number, "provenance": provenance,
    }  # fmt: skip
    return {
        "schema": "streamkit.tracks/1", "source": SCRIPT, "seq": number, "epoch": 0,
        "pts_ns": number * 200_000_000, "width": 320, "height": 240, "tracks": [track], "dropped": 0,
        "registration": {"reference": 0, "status": "ok", "to_reference": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]},
    }  # fmt: skip


@pytest.mark.timeout(240)
def test_axe_finds_nothing_serious(
    browser: Chrome, serve_keys: Callable[..., str], key: str, wait_for: Callable[..., Any], tmp_path: Path
) -> None:
    """axe-core 4.14.1, which the folder axe holds with its licence, on a full page, light and dark."""
    url = serve_keys(key, f"{key}/second")
    run = tmp_path / "tracks.jsonl"
    run.write_text("".join(json.dumps(written_record(number)) + "\n" for number in range(1000)))
    launch = (
        f"tracksrc location={run} ! identity sync=true ! zenohsink name=z key={key} control=true "
        "videotestsrc is-live=true ! video/x-raw, width=320, height=240, framerate=5/1 "
        "! framediff name=moving ! z.frame"
    )
    with Pipeline.parse(launch) as pipeline:
        pipeline.play()
        browser.get(url)
        wait_for(lambda: browser.find_elements(By.CSS_SELECTOR, "#rows button"))[0].click()
        wait_for(lambda: "It is" in text(browser, "explain"))
        assert SCRIPT in text(browser, "explain")
        assert browser.execute_script("return window.hacked === undefined")
        assert browser.find_element(By.ID, "map").is_displayed()
        wait_for(lambda: browser.find_elements(By.CSS_SELECTOR, "details[data-element=moving]"))
        browser.execute_script("for (const item of document.querySelectorAll('details')) item.open = true")
        browser.execute_script("document.getElementById('stream').hidden = false")  # as with coded video
        browser.execute_script((Path(__file__).parent / "axe" / "axe.min.js").read_text())
        for scheme in ("light", "dark"):
            feature = {"name": "prefers-color-scheme", "value": scheme}
            browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})
            found = browser.execute_async_script("axe.run().then(arguments[0])")
            assert len(found["passes"]) > 15
            serious = [item for item in found["violations"] if item["impact"] in ("serious", "critical")]
            assert [(item["id"], [node["html"] for node in item["nodes"]]) for item in serious] == []


@pytest.mark.timeout(120)
def test_everything_can_be_reached_and_has_a_name(
    browser: Chrome, serve_keys: Callable[..., str], wait_for: Callable[..., Any], key: str
) -> None:
    """Feeds are buttons with a state; canvases have names; nothing is wider than a phone's screen."""
    set_screen(browser, 390, 844, scale=2)
    browser.get(serve_keys(key, f"{key}/second"))
    buttons = wait_for(lambda: browser.find_elements(By.CSS_SELECTOR, "#feeds button"))
    assert [button.get_attribute("aria-pressed") for button in buttons] == ["true", "false"]
    buttons[1].send_keys("\n")
    wait_for(lambda: buttons[1].get_attribute("aria-pressed") == "true")
    for found in browser.find_elements(
        By.CSS_SELECTOR, "canvas:not([aria-hidden]), button, section, nav, table"
    ):
        if found.is_displayed() and found.tag_name != "table":
            assert found.accessible_name, found.get_attribute("outerHTML")
    wait_for(lambda: browser.execute_script("return document.documentElement.scrollWidth") <= 390)
    note = wait_for(lambda: browser.find_element(By.ID, "note"))
    assert note.rect["x"] + note.rect["width"] <= 390  # also with a long key in it
    wait_for(lambda: browser.find_elements(By.CSS_SELECTOR, "#figures dt"))
    for name in ("#figures dt", "#explain", "#fault"):  # an element may have a name without end
        width = browser.execute_script(LONG_TEXT, name)
        assert width <= 390, name
