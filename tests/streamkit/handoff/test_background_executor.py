"""BackgroundExecutor: order, bounds, results, and closing."""

import threading

import pytest

from streamkit.handoff.background_executor import BackgroundExecutor


@pytest.fixture
def failures():
    """Exceptions of work without a future."""
    return []


@pytest.fixture
def worker(failures):
    """A worker with room for ten bytes."""
    worker = BackgroundExecutor("test mosaic", failures.append, max_bytes=10)
    yield worker
    assert worker.close(10.0)


def test_work_is_done_in_order(worker):
    """Each piece after the one before it; the future has what the work gave."""
    done = []
    for number in range(50):
        worker.submit_waiting(lambda number=number: done.append(number))
    assert worker.submit(lambda: len(done)).result(10) == 50
    assert done == list(range(50))


def test_do_waits_for_room(worker):
    """Memory is bounded; nothing is lost."""
    gate, handed, done = threading.Event(), threading.Event(), []

    def hand_over():
        for number in range(3):
            worker.submit_waiting(lambda number=number: (gate.wait(30), done.append(number)), 8)
        handed.set()

    thread = threading.Thread(target=hand_over)
    thread.start()
    assert not handed.wait(0.2)
    gate.set()
    assert handed.wait(10)
    thread.join()
    worker.submit(lambda: None).result(10)
    assert done == [0, 1, 2]


def test_a_cancelled_wait_for_room_loses_no_work(worker):
    """The work is added all the same."""
    gate, cancelled, done = threading.Event(), threading.Event(), []
    cancelled.set()
    for number in range(3):
        worker.submit_waiting(lambda number=number: (gate.wait(30), done.append(number)), 8, cancelled)
    gate.set()
    worker.submit(lambda: None).result(10)
    assert done == [0, 1, 2]


def test_failures_are_set_on_the_future(worker, failures):
    """Others are reported to `failed`; work continues."""

    def fail():
        raise OSError("disk full")

    worker.submit_waiting(fail)
    with pytest.raises(OSError, match="disk full"):
        worker.submit(fail).result(10)
    assert [str(error) for error in failures] == ["disk full"]


def test_a_wait_continues_while_there_is_progress(worker):
    """Patience counts from the last progress."""
    gate = threading.Event()
    stuck = worker.submit(lambda: gate.wait(30))
    assert not worker.wait(stuck, 0.05)
    gate.set()
    assert worker.wait(stuck, 10.0)
    asked = worker.submit(lambda: 1)
    assert worker.wait(asked, 10.0)
    assert asked.result() == 1


def test_a_wait_ends_when_cancelled(worker):
    """A pipeline that stops does not wait in its streaming thread."""
    gate, cancelled = threading.Event(), threading.Event()
    cancelled.set()
    asked = worker.submit(lambda: gate.wait(30))
    assert not worker.wait(asked, 30.0, cancelled)
    gate.set()


def test_closing_abandons_unfinished_work(failures):
    """Work that reports progress ends; waiting work never begins."""
    worker = BackgroundExecutor("test mosaic", failures.append, max_bytes=10)
    begun, done = threading.Event(), []

    def breathing():
        begun.set()
        while True:
            worker.report_progress()

    running, waiting = worker.submit(breathing), worker.submit(lambda: done.append(1))
    assert begun.wait(10)
    assert worker.close(10.0)
    assert running.cancelled()
    assert waiting.cancelled()
    assert worker.submit(lambda: 1).cancelled()
    assert (done, failures) == ([], [])


class _Link:
    """Sends nothing until it is opened."""

    def __init__(self):
        self.sent = []
        self.is_open = threading.Event()
        self.is_busy = threading.Event()

    def send(self, payload):
        self.is_busy.set()
        assert self.is_open.wait(10)
        if payload == "bad":
            raise OSError("link down")
        self.sent.append(payload)


@pytest.fixture
def link():
    """A link that is opened at the latest when the test ends."""
    link = _Link()
    yield link
    link.is_open.set()


@pytest.fixture
def sender(failures, link):
    """Makes executors of a capacity; each ends after the test."""
    made = []

    def make(capacity):
        executor = BackgroundExecutor("test sender", failures.append, capacity=capacity)
        made.append(executor)

        def offer(payload, wait_s=0.0, cancelled=None):
            return executor.submit_dropping(lambda: link.send(payload), wait_s, cancelled)

        return executor, offer

    yield make
    link.is_open.set()
    for executor in made:
        assert executor.close(5.0)


def test_offered_work_is_done_in_order(sender, link, failures):
    """With patience nothing is dropped, however small the capacity."""
    link.is_open.set()
    executor, offer = sender(2)
    assert sum(offer(number, 10.0) for number in range(200)) == 0
    assert executor.wait_idle(10.0) == 0
    assert (link.sent, failures) == (list(range(200)), [])
    assert executor.abandon() == 0


def test_a_full_executor_drops_the_oldest(sender, link):
    """Without patience the newest are kept and the number of dropped pieces is returned."""
    executor, offer = sender(3)
    assert offer("first") == 0
    assert link.is_busy.wait(5)
    assert [offer(number) for number in range(5)] == [0, 0, 0, 1, 1]
    link.is_open.set()
    assert executor.wait_idle(5.0) == 0
    assert link.sent == ["first", 2, 3, 4]


def test_a_stuck_executor_is_waited_for_once(sender, link):
    """After one timeout, offers return at once until a piece is done."""
    executor, offer = sender(1)
    offer("first")
    assert link.is_busy.wait(5)
    offer("a")
    assert offer("b", 0.1) == 1
    # A wait of an hour would end the test by its time limit.
    assert offer("c", 3600.0) == 1
    link.is_open.set()
    assert executor.wait_idle(5.0) == 0
    assert offer("d", 3600.0) == 0
    executor.wait_idle(5.0)
    assert link.sent == ["first", "c", "d"]


def test_a_cancelled_offer_ends_at_once(sender, link):
    """A pipeline that stops does not wait for room, nor until all is done."""
    executor, offer = sender(1)
    stopping = threading.Event()
    stopping.set()
    offer("first")
    assert link.is_busy.wait(5)
    offer("a")
    assert offer("b", 3600.0, stopping) == 1
    assert executor.wait_idle(3600.0, stopping) == 2


def test_waiting_for_the_end_returns_what_is_left(sender, link):
    """The wait ends when nothing moves for its patience; what is abandoned is counted."""
    executor, offer = sender(4)
    for payload in ("a", "b", "c"):
        offer(payload)
    assert link.is_busy.wait(5)
    assert executor.wait_idle(0.1) == 3
    assert executor.abandon() == 2
    assert offer("d") == 0
    link.is_open.set()
    assert executor.close(5)
    assert link.sent == ["a"]


def test_a_failure_does_not_end_the_executor(sender, link, failures):
    """One piece that fails is reported; the next ones are done."""
    link.is_open.set()
    executor, offer = sender(4)
    for payload in ("a", "bad", "b"):
        offer(payload, 5.0)
    assert executor.wait_idle(5.0) == 0
    assert link.sent == ["a", "b"]
    assert [str(failure) for failure in failures] == ["link down"]


def test_periodic_work_is_done_between_pieces(failures, monkeypatch):
    """Without any piece, and while pieces keep coming; a failure is reported and does not end it."""
    ticked, done = threading.Semaphore(0), []

    def tick():
        ticked.release()
        raise OSError("no status")

    monkeypatch.setattr("streamkit.handoff.background_executor.PERIOD_S", 0.01)
    executor = BackgroundExecutor("test ticks", failures.append, periodic=tick)
    assert all(ticked.acquire(timeout=10) for _ in range(3))
    offered = 0
    while not ticked.acquire(timeout=0) or offered < 100:
        executor.submit_dropping(lambda number=offered: done.append(number))
        offered += 1
    assert executor.wait_idle(10.0) == 0
    assert done == list(range(offered))
    assert executor.close(10)
    assert {str(failure) for failure in failures} == {"no status"}
