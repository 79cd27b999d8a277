"""What waits for a page is bounded, and a slow page goes on at the newest keyframe."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit_view import hub as module
from streamkit_view.hub import WAITING_BYTES, WINDOW_MESSAGES, InvalidAnswer, Viewer
from streamkit_view.messages import (
    BACK,
    CONTROL,
    FRAME,
    MOSAIC,
    SKIPPED,
    STATE,
    TILE,
    TRACKS,
    VIDEO,
    PageMessage,
)


def packet(number: int, *, is_keyframe: bool = False, size: int = 100) -> PageMessage:
    """A video message that begins with its number."""
    return PageMessage(VIDEO, 0, b"%08d" % number + bytes(size), is_keyframe)


def take_all(viewer: Viewer) -> list[PageMessage]:
    """What a page gets that confirms everything."""
    taken: list[PageMessage] = []
    while (message := viewer.next()) is not None:
        taken.append(message)
        viewer.confirm(len(taken))
    return taken


def test_a_fast_page_gets_everything_in_order() -> None:
    """Nothing is skipped while the page confirms."""
    viewer = Viewer()
    sent = [packet(number, is_keyframe=number % 25 == 0) for number in range(80)]
    for message in sent:
        viewer.offer(message)
    assert take_all(viewer) == sent


def test_a_page_that_confirms_nothing_is_sent_a_bounded_amount() -> None:
    """The rest waits, bounded; after ten seconds the page is stuck."""
    viewer = Viewer()
    for number in range(5000):
        viewer.offer(packet(number, is_keyframe=number % 25 == 0, size=10_000))
    under_way = 0
    while viewer.next() is not None:
        under_way += 1
    assert under_way == WINDOW_MESSAGES
    assert viewer._stream_bytes <= WAITING_BYTES
    assert not viewer.is_stuck


def test_a_stuck_page_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only one to which something is under way."""
    now = [100.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    viewer = Viewer()
    now[0] += 60
    assert not viewer.is_stuck
    viewer.offer(packet(0, is_keyframe=True))
    viewer.next()
    assert not viewer.is_stuck
    now[0] += 11
    assert viewer.is_stuck
    viewer.confirm(1)
    assert not viewer.is_stuck


@given(st.integers(2, 400), st.integers(601, 3000))
def test_a_slow_page_goes_on_at_a_keyframe_and_hears_how_many_it_missed(group: int, count: int) -> None:
    """Numbers are consecutive but for the skipped ones, which are counted; a keyframe follows each gap."""
    viewer = Viewer()
    for number in range(count):
        viewer.offer(packet(number, is_keyframe=number % group == 0))
    viewer.offer(packet(count, is_keyframe=True))
    expected = 0
    for message in take_all(viewer):
        if message.kind == SKIPPED:
            expected += json.loads(message.data)["body"]["frames"]
            continue
        assert isinstance(message.data, bytes)
        number = int(message.data[:8])
        assert number == expected
        expected = number + 1
    assert expected == count + 1


def test_a_page_that_is_late_goes_on_at_the_next_keyframe(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two seconds late it skips what waits, though that is little; one that keeps up skips nothing."""
    now = [0.0]
    monkeypatch.setattr(module.time, "monotonic", lambda: now[0])
    slow, fast = Viewer(), Viewer()
    sent: list[PageMessage] = []
    for number in range(260):
        now[0] = number * 0.04
        slow.offer(packet(number, is_keyframe=number % 25 == 0))
        fast.offer(packet(number, is_keyframe=number % 25 == 0))
        fast.confirm(number)
        taken = fast.next()
        assert taken is not None
        assert taken.data == packet(number).data
        slow.confirm(number // 5)  # it takes one of five
        while (message := slow.next()) is not None:
            sent.append(message)
    kinds = [message.kind for message in sent]
    assert kinds.count(SKIPPED) == 1
    at = kinds.index(SKIPPED)
    skipped = json.loads(sent[at].data)["body"]["frames"]
    assert skipped > 20
    assert sent[at + 1] == packet(at + skipped, is_keyframe=True)


def test_a_late_page_hears_of_skipped_frames_before_a_keyframe_comes() -> None:
    """The stream may have no other: then the page shows stills."""
    viewer = Viewer()
    for number in range(800):
        viewer.offer(packet(number, is_keyframe=number == 0))
    (notice,) = take_all(viewer)
    assert notice.kind == SKIPPED
    assert json.loads(notice.data)["body"]["frames"] == 800


def test_frames_that_are_not_skipped_keep_their_records() -> None:
    """A page that goes on at a keyframe shows its boxes."""
    viewer = Viewer()
    for number in range(0, 640, 2):
        viewer.offer(packet(number, is_keyframe=number == 400))
        viewer.offer(PageMessage(TRACKS, 0, f"{number:08d}"))
    taken = take_all(viewer)
    assert taken[0].kind == SKIPPED
    numbers = {kind: [int(one.data[:8]) for one in taken if one.kind == kind] for kind in (VIDEO, TRACKS)}
    assert numbers[VIDEO] == numbers[TRACKS] == list(range(400, 640, 2))


def test_of_pictures_and_states_only_the_newest_waits() -> None:
    """Records are kept for the frames that wait with them."""
    viewer = Viewer()
    for number in range(10):
        viewer.offer(PageMessage(FRAME, 0, str(number)))
        viewer.offer(PageMessage(STATE, 0, str(number)))
        viewer.offer(PageMessage(TRACKS, 0, str(number)))
    taken = take_all(viewer)
    assert [message.kind for message in taken].count(TRACKS) == 10
    assert [message.kind for message in taken if message.kind != TRACKS] == [FRAME, STATE]


def test_of_a_mosaic_the_newest_of_each_tile_waits() -> None:
    """Tiles follow the mosaic that they are of, also to a page that is late; those of another do not wait."""
    viewer = Viewer()
    viewer.offer(PageMessage(MOSAIC, 0, "old"))
    viewer.offer(PageMessage(TILE, 0, "old", part=(5, 5)))
    viewer.offer(PageMessage(TILE, 1, "of another feed", part=(5, 5)))
    viewer.offer(PageMessage(MOSAIC, 0, "new"))
    for number in range(1500):
        viewer.offer(packet(number, is_keyframe=number % 25 == 0))
        viewer.offer(PageMessage(TILE, 0, str(number), part=(number % 10, 3)))
    taken = [message for message in take_all(viewer) if message.kind in (MOSAIC, TILE)]
    assert [message.data for message in taken[:2]] == ["of another feed", "new"]
    assert {message.part: message.data for message in taken[2:]} == {
        (number % 10, 3): str(number) for number in range(1490, 1500)
    }


@pytest.mark.parametrize("count", [-1, 2, 10**30])
def test_a_wrong_confirmation_is_refused(count: int) -> None:
    """A page cannot confirm what it was not sent."""
    viewer = Viewer()
    viewer.offer(packet(0))
    viewer.next()
    with pytest.raises(InvalidAnswer):
        viewer.confirm(count)


def test_the_past_begins_anew_with_what_says_so() -> None:
    """Skipped frames of the live video are not counted for the past, nor its keyframe waited for."""
    viewer = Viewer()
    for number in range(2000):
        viewer.offer(packet(number))
    viewer.select(0, is_live=False)
    viewer.offer(PageMessage(BACK, 0, "20"))
    sent = [packet(number, is_keyframe=number == 0) for number in range(3)]
    for message in sent:
        viewer.offer(message)
    assert not viewer.is_live
    assert [message.kind for message in take_all(viewer)] == [BACK, VIDEO, VIDEO, VIDEO]


@pytest.mark.parametrize("kind", [BACK, CONTROL])
def test_a_page_that_asks_without_reading_has_few_replies_waiting(kind: str) -> None:
    """The newest; a page cannot make the server keep more and more."""
    viewer = Viewer()
    for number in range(1000):
        viewer.offer(PageMessage(kind, 0, str(number)))
    assert [message.data for message in take_all(viewer)] == [str(number) for number in range(984, 1000)]


def test_a_page_with_video_gets_no_images() -> None:
    """Until it shows another feed, or another time, which may have no video."""
    viewer = Viewer()
    viewer.shows_stills = False
    viewer.offer(PageMessage(FRAME, 0, "unseen"))
    assert viewer.next() is None
    viewer.select(1)
    viewer.offer(PageMessage(FRAME, 1, "seen"))
    assert [message.data for message in take_all(viewer)] == ["seen"]


def test_another_feed_begins_anew() -> None:
    """What waits of the feed before is not sent."""
    viewer = Viewer()
    viewer.offer(packet(0, is_keyframe=True))
    viewer.select(1)
    assert viewer.next() is None
