"""The mosaic reaches a subscriber while it grows."""

from __future__ import annotations

import threading

import cv2
import numpy as np
import zenoh

from streamkit import Pipeline
from streamkit_zenoh.configuration import SessionSettings
from streamkit_zenoh.session import close_session, open_session
from tests.ports import free_port
from tests.waiting import wait_for

KEY = "acceptance/mosaic"


def test_the_growing_mosaic_is_published() -> None:
    """From the stitcher's pad to zenohsink's: mosaics that grow, and the last one for later queries."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    session = open_session(SessionSettings(listen=endpoint))
    samples: list[zenoh.Sample] = []
    held = threading.Lock()

    def take(sample: zenoh.Sample) -> None:
        with held:
            samples.append(sample)

    session.declare_subscriber(f"{KEY}/mosaic", zenoh.handlers.Callback(take, indirect=False))
    text = (
        "dronetestsrc num-buffers=60 seed=1 ! video/x-raw, width=320, height=240 ! stitch name=ground "
        f"preview-interval=0.2 ! zenohsink name=out key={KEY} connect={endpoint} mosaic-format=png "
        "ground.mosaic ! queue ! out.mosaic"
    )
    try:
        with Pipeline.parse(text) as pipeline:
            pipeline.ready()
            assert wait_for(lambda: pipeline["out"]._publication.media["mosaic"].has_subscriber)
            pipeline.play()
            message = pipeline.wait(60)
            assert message is not None
            assert message.error is None
    finally:
        close_session(session, 5.0)
    with held:
        images = [cv2.imdecode(np.frombuffer(s.payload.to_bytes(), np.uint8), 1) for s in samples]
    assert len(images) >= 2
    assert (images[-1] > 0).sum() > (images[0] > 0).sum()
