"""What a person sees: the page in a real browser."""

from __future__ import annotations

import base64
import itertools
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from selenium.webdriver import Chrome
from selenium.webdriver.common.by import By

from streamkit import Pipeline
from streamkit_video import TrueTargets
from streamkit_zenoh.configuration import SessionSettings
from streamkit_zenoh.session import close_session, open_session
from streamkit_zenoh.wire.status import DropCount, StatusRecord

STREAMKIT = str(Path(sys.executable).with_name("streamkit"))
FLIGHT = "dronetestsrc num-buffers=120 seed=1 ! video/x-raw, format=BGR, width=1280, height=720"
FRAME_NS = 40_000_000
YELLOW = (10, 214, 255)  # of confirmed targets, BGR
LIVE = (
    "videotestsrc is-live=true pattern=ball ! video/x-raw, width=320, height=240, framerate=25/1 "
    "! tee name=t ! zenohsink name=z key={key}  t. ! encode gop=25 live=true ! z.video"
)
SCRIPT = "<img src=x onerror='window.hacked=1'><script>window.hacked=1</script>"


def canvas(browser: Chrome, name: str) -> np.ndarray[Any, Any]:
    """The pixels of a canvas, uint8[h, w, 4] BGRA."""
    url = browser.execute_script(f"return document.getElementById('{name}').toDataURL('image/png')")
    data = np.frombuffer(base64.b64decode(url.partition(",")[2]), np.uint8)
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED))


def text(browser: Chrome, name: str) -> str:
    """What is written in an element; "" where it is hidden."""
    return browser.find_element(By.ID, name).text


@contextmanager
def publisher(key: str) -> Iterator[subprocess.Popen[bytes]]:
    """A live publisher in a process of its own."""
    process = subprocess.Popen([STREAMKIT, "launch", "-q", LIVE.format(key=key)], stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait(10)


def true_frame(number: int) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Pixels and centres of the cars of one frame of the flight."""
    with Pipeline.parse(f"{FLIGHT} ! appsink name=out max-buffers=4") as pipeline:
        pipeline.play()
        frame = next(itertools.islice(pipeline["out"], number, None))
        return np.asarray(frame.data), np.asarray(frame.get(TrueTargets).centres)


def drawn_boxes(overlay: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Centres of the boxes of confirmed targets, px of the overlay."""
    is_yellow = (np.abs(overlay[:, :, :3].astype(int) - YELLOW).max(2) < 30) & (overlay[:, :, 3] > 250)
    _, _, rows, _ = cv2.connectedComponentsWithStats(is_yellow.astype(np.uint8), connectivity=8)
    boxes = [row for row in rows[1:] if min(row[2], row[3]) >= 12 and row[4] < 0.7 * row[2] * row[3]]
    return np.array([(x + (width - 1) / 2, y + (height - 1) / 2) for x, y, width, height, _ in boxes])


@pytest.mark.timeout(180)
def test_a_file_is_shown_with_boxes_on_the_cars(
    browser: Chrome, start_view: Callable[..., Any], wait_for: Callable[..., Any], tmp_path: Path
) -> None:
    """The picture moves; at the end it is the file's last frame, with boxes within 4 px of the true cars."""
    flight = tmp_path / "flight.mp4"
    Pipeline.parse(f"{FLIGHT} ! videofilesink location={flight}").run(timeout_s=60)
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": 1800, "height": 1100, "deviceScaleFactor": 1, "mobile": False},
    )
    server = start_view(str(flight))
    browser.get(server.url)
    wait_for(lambda: text(browser, "state") == "playing", 100)
    wait_for(lambda: browser.execute_script("return streamkit.page.video && streamkit.page.shown !== null"))
    first = canvas(browser, "video")
    assert first.shape[:2] == (720, 1280)
    wait_for(lambda: np.abs(canvas(browser, "video").astype(int) - first).mean() > 2)
    wait_for(lambda: text(browser, "state") == "ended")
    wait_for(lambda: browser.execute_script("return streamkit.page.shown.isExact && !streamkit.page.next"))
    number = browser.execute_script("return streamkit.page.shown.header.pts_ns") // FRAME_NS
    assert number >= 115
    pixels, cars = true_frame(number)
    shown = canvas(browser, "video")[:, :, :3]
    assert np.abs(shown.astype(int) - pixels).mean() < 6
    overlay = canvas(browser, "overlay")
    scale = min(overlay.shape[1] / 1280, overlay.shape[0] / 720)
    margins = (overlay.shape[1] - 1280 * scale) / 2, (overlay.shape[0] - 720 * scale) / 2
    boxes = (drawn_boxes(overlay) - margins) / scale
    inside = boxes[(boxes > 30).all(1) & (boxes < np.array([1250, 690])).all(1)]
    assert len(inside) >= 5
    apart = np.linalg.norm(inside[:, None] - cars[None], axis=2).min(1)
    assert np.sort(apart)[int(0.8 * len(apart))] <= 4
    assert browser.find_element(By.ID, "mosaic").is_displayed()
    assert text(browser, "feeds") == "flight.mp4"
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []


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


@pytest.mark.timeout(120)
def test_stills_are_shown_without_coded_video(
    browser: Chrome, start_view: Callable[..., Any], key: str, wait_for: Callable[..., Any]
) -> None:
    """The images of KEY/frame do where nothing else is published."""
    browser.get(start_view(key).url)
    description = f"videotestsrc is-live=true pattern=ball ! zenohsink key={key} frame-rate=10"
    with Pipeline.parse(description) as pipeline:
        pipeline.play()
        wait_for(lambda: "stills" in text(browser, "figures"))
        first = canvas(browser, "video")
        wait_for(lambda: not np.array_equal(canvas(browser, "video"), first))


@pytest.mark.timeout(120)
def test_text_from_the_network_stays_text(
    browser: Chrome, start_view: Callable[..., Any], key: str, wait_for: Callable[..., Any]
) -> None:
    """A status with markup in its strings is shown letter by letter, and runs nothing."""
    browser.get(start_view(key).url)
    status = StatusRecord(
        schema="streamkit.status/1", source=SCRIPT, state="playing", run=1, published_ns=1, uptime_s=1.0,
        frames=1, tracks=0, streams=(), drops=(DropCount(stream=SCRIPT, reason=SCRIPT, count=7),),
    )  # fmt: skip
    session = open_session(SessionSettings())
    try:
        publishing = session.declare_publisher(
            f"{key}/status", encoding="application/json;streamkit.status/1"
        )

        def is_shown() -> bool:
            publishing.put(msgspec.json.encode(status))
            return SCRIPT in text(browser, "figures")

        wait_for(is_shown)
        assert browser.execute_script("return window.hacked === undefined")
        assert not browser.find_elements(By.CSS_SELECTOR, "dl img, dl script")
    finally:
        close_session(session, 5.0)


@pytest.mark.timeout(120)
def test_everything_can_be_reached_and_has_a_name(
    browser: Chrome, start_view: Callable[..., Any], wait_for: Callable[..., Any], key: str
) -> None:
    """Feeds are buttons with a state; canvases have names; nothing is wider than a phone's screen."""
    browser.get(start_view(key, f"{key}/second").url)
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True},
    )
    buttons = wait_for(lambda: browser.find_elements(By.CSS_SELECTOR, "#feeds button"))
    assert [button.get_attribute("aria-pressed") for button in buttons] == ["true", "false"]
    buttons[1].send_keys("\n")
    wait_for(lambda: buttons[1].get_attribute("aria-pressed") == "true")
    for found in browser.find_elements(
        By.CSS_SELECTOR, "canvas:not([aria-hidden]), button, section, nav, table"
    ):
        if found.is_displayed() and found.tag_name != "table":
            assert found.accessible_name, found.get_attribute("outerHTML")
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 390
