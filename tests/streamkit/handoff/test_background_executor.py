"""BackgroundExecutor: order, bounds, results, and an end that waits for nothing."""

import threading

import pytest

from streamkit.handoff.background_executor import BackgroundExecutor


@pytest.fixture
def failures():
    """What work raised for whose result nobody asked."""
    return []


@pytest.fixture
def worker(failures):
    """A worker with room for ten bytes."""
    worker = BackgroundExecutor("test mosaic", 10, failures.append)
    yield worker
    assert worker.close(10.0)


def test_work_is_done_in_order(worker):
    """Each piece after the one before it; the future has what the work gave."""
    done = []
    for number in range(50):
        worker.do(lambda number=number: done.append(number))
    assert worker.ask(lambda: len(done)).result(10) == 50
    assert done == list(range(50))


def test_whoever_hands_over_more_than_the_capacity_waits(worker):
    """Memory is bounded; nothing is lost; the wait ends when there is room."""
    gate, handed, done = threading.Event(), threading.Event(), []

    def hand_over():
        for number in range(3):
            worker.do(lambda number=number: (gate.wait(30), done.append(number)), 8)
        handed.set()

    thread = threading.Thread(target=hand_over)
    thread.start()
    assert not handed.wait(0.2)
    gate.set()
    assert handed.wait(10)
    thread.join()
    worker.ask(lambda: None).result(10)
    assert done == [0, 1, 2]


def test_a_cancelled_wait_for_room_loses_no_work(worker):
    """A pipeline that stops still gets its last picture into the mosaic."""
    gate, cancelled, done = threading.Event(), threading.Event(), []
    cancelled.set()
    for number in range(3):
        worker.do(lambda number=number: (gate.wait(30), done.append(number)), 8, cancelled)
    gate.set()
    worker.ask(lambda: None).result(10)
    assert done == [0, 1, 2]


def test_failures_reach_whoever_asks(worker, failures):
    """The future has the exception of work that was asked for; others are told, and work goes on."""

    def fail():
        raise OSError("disk full")

    worker.do(fail)
    with pytest.raises(OSError, match="disk full"):
        worker.ask(fail).result(10)
    assert [str(error) for error in failures] == ["disk full"]


def test_a_wait_goes_on_while_there_is_progress(worker):
    """Patience counts from the last sign of life; without one the wait ends."""
    gate = threading.Event()
    stuck = worker.ask(lambda: gate.wait(30))
    assert not worker.wait(stuck, 0.05)
    gate.set()
    assert worker.wait(stuck, 10.0)
    asked = worker.ask(lambda: 1)
    assert worker.wait(asked, 10.0)
    assert asked.result() == 1


def test_a_wait_ends_when_cancelled(worker):
    """A pipeline that stops does not wait in its streaming thread."""
    gate, cancelled = threading.Event(), threading.Event()
    cancelled.set()
    asked = worker.ask(lambda: gate.wait(30))
    assert not worker.wait(asked, 30.0, cancelled)
    gate.set()


def test_closing_abandons_what_is_not_done(failures):
    """Work that breathes ends at once, what waits never begins, and the thread ends."""
    worker = BackgroundExecutor("test mosaic", 10, failures.append)
    begun, done = threading.Event(), []

    def breathing():
        begun.set()
        while True:
            worker.report_progress()

    running, waiting = worker.ask(breathing), worker.ask(lambda: done.append(1))
    assert begun.wait(10)
    assert worker.close(10.0)
    assert running.cancelled()
    assert waiting.cancelled()
    assert worker.ask(lambda: 1).cancelled()
    assert (done, failures) == ([], [])
