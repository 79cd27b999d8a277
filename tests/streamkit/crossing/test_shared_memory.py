"""Slots: arrays in shared memory keep values, layout and life."""

import os
from collections import deque

import numpy as np
import pytest

from streamkit.crossing.shared_memory import (
    MAX_KEPT_DESCRIPTORS,
    NewSlot,
    NumberRing,
    SlotReader,
    SlotWriter,
    make_numbers,
    map_numbers,
)


def pass_on(writer: SlotWriter, reader: SlotReader, array: np.ndarray) -> np.ndarray:
    """The array as the reader sees it."""
    place, made = writer.write(array)
    if made is not None:
        reader.add(made)
    return reader.read(place)


def give_back(writer: SlotWriter, reader: SlotReader) -> int:
    """Tells the writer which slots are free; returns their number."""
    count = len(reader.released)
    while reader.released:
        writer.release(reader.released.popleft())
    return count


@pytest.mark.parametrize(
    "array",
    [
        np.arange(24, dtype=np.uint8).reshape(4, 6),
        np.arange(48, dtype=np.uint8).reshape(4, 12)[:, :8],  # rows with a gap, as decoders make them
        np.arange(24.0).reshape(4, 6).T,
        np.arange(240, dtype=np.int16).reshape(10, 24)[::5, ::-3],
        np.zeros((0, 5), np.float32),
        np.array([True]),
    ],
)
def test_an_array_keeps_values_and_layout(array: np.ndarray) -> None:
    """Values, type and shape always; strides unless they leave large gaps."""
    found = pass_on(SlotWriter(), SlotReader(), array)
    assert found.dtype == array.dtype
    assert np.array_equal(found, array)
    if array.size and min(array.strides) > 0 and np.ptp(array.shape) < 8:
        assert found.strides == array.strides
    assert not found.flags.writeable


def test_a_slot_is_used_again_once_no_view_is_left() -> None:
    """A view of a view keeps the memory; the writer makes another slot meanwhile."""
    writer, reader = SlotWriter(), SlotReader()
    view = pass_on(writer, reader, np.full((4, 4), 7, np.uint8))[1:][1:, 2:]
    assert give_back(writer, reader) == 0
    other = pass_on(writer, reader, np.full((4, 4), 8, np.uint8))
    assert np.all(view == 7)
    assert np.all(other == 8)
    del view, other
    assert give_back(writer, reader) == 2
    for value in range(10):
        assert np.all(pass_on(writer, reader, np.full((4, 4), value, np.uint8)) == value)
        assert give_back(writer, reader) == 1


def test_larger_frames_get_larger_slots() -> None:
    """A frame of an earlier size stays what it was."""
    writer, reader = SlotWriter(), SlotReader()
    small = pass_on(writer, reader, np.full((4, 4), 1, np.uint8))
    large = pass_on(writer, reader, np.full((400, 400), 2, np.uint8))
    assert np.all(small == 1)
    assert np.all(large == 2)
    del small, large
    give_back(writer, reader)
    assert np.all(pass_on(writer, reader, np.full((10, 10), 3, np.uint8)) == 3)


def test_few_descriptors_stay_open() -> None:
    """However many frames are kept; none once they are gone."""
    before = len(os.listdir("/proc/self/fd"))
    writer, reader = SlotWriter(), SlotReader()
    kept = [pass_on(writer, reader, np.full((8, 8), value, np.uint8)) for value in range(50)]
    assert len(os.listdir("/proc/self/fd")) == before + MAX_KEPT_DESCRIPTORS
    assert all(np.all(array == value) for value, array in enumerate(kept))
    kept.append(pass_on(writer, reader, np.full((80, 80), 50, np.uint8)))
    kept.clear()
    assert len(os.listdir("/proc/self/fd")) == before


def test_an_array_from_another_process_is_sent_on_without_a_copy() -> None:
    """Its slot is free once the third process, too, no longer uses it."""
    first, second = (SlotWriter(), SlotReader()), (SlotWriter(), SlotReader())
    for value in range(40):
        received = pass_on(*first, np.full((4, 6), value, np.uint8))
        sent_on = pass_on(*second, received)
        again = pass_on(*second, received[:2])
        assert np.all(sent_on == value)
        assert again.shape == (2, 6)
        first[0]._slots[0][0] = 99  # a view of the same memory sees it
        assert sent_on[0, 0] == again[0, 0] == 99
        del received
        assert give_back(*first) == 0
        del sent_on
        assert give_back(*second) == 1
        assert give_back(*first) == 0
        del again
        assert give_back(*second) == 1
        assert give_back(*first) == 1


def test_a_part_inside_an_array_is_copied() -> None:
    """Such as a crop; the array itself may then be given back."""
    first, second = (SlotWriter(), SlotReader()), (SlotWriter(), SlotReader())
    received = pass_on(*first, np.arange(24, dtype=np.uint8).reshape(4, 6))
    part = pass_on(*second, received[1:, 2:])
    assert np.array_equal(part, received[1:, 2:])
    del received
    assert give_back(*first) == 1


def test_slots_that_are_gone_are_forgotten_by_all() -> None:
    """Frames that grow make new slots in each process; the old ones do not stay mapped."""
    first, second = (SlotWriter(), SlotReader()), (SlotWriter(), SlotReader())
    for size in range(10, 40):
        assert np.all(pass_on(*second, pass_on(*first, np.full((size, size), size, np.uint8))) == size)
        assert np.all(pass_on(*second, np.full((size + 1, size), size, np.uint8)) == size)
        give_back(*second)
        give_back(*first)
    assert len(first[1]._slots) <= 2
    assert len(second[1]._slots) <= 4


def test_memory_that_could_shrink_is_refused() -> None:
    """The other process could end this one by it."""
    descriptor = os.memfd_create("test")
    os.ftruncate(descriptor, 100)
    with pytest.raises(ValueError, match="sealed"):
        SlotReader().add(NewSlot(0, 100, (), descriptor))


@pytest.mark.parametrize(
    ("dtype", "shape", "strides"),
    [("|u1", (101,), (1,)), ("|O", (1,), (8,)), ("|u1", (5,), (-1,)), ("|u1", (2**40,), (0,))],
)
def test_a_place_outside_the_slot_is_refused(dtype: str, shape: tuple, strides: tuple) -> None:
    """Whatever the other process says, only its memory is read."""
    writer, reader = SlotWriter(), SlotReader()
    place, made = writer.write(np.zeros(100, np.uint8))
    assert made is not None
    reader.add(made)
    with pytest.raises((ValueError, TypeError)):
        reader.read(place._replace(dtype=dtype, shape=shape, strides=strides))


def test_integers_are_shared_and_outlive_the_descriptor() -> None:
    """They begin at zero; each side sees what the other writes."""
    ours, descriptor = make_numbers(3)
    theirs = map_numbers(descriptor, 3)
    os.close(descriptor)
    assert ours.tolist() == [0, 0, 0]
    ours[0], theirs[2] = -1, 2**40
    assert theirs.tolist() == ours.tolist() == [-1, 0, 2**40]


def test_numbers_of_a_ring_arrive_in_order() -> None:
    """However many there are: those for which there is no room wait for their turn."""
    words = memoryview(bytearray(8 * 4)).cast("q")
    ours, theirs, waiting = NumberRing(words), NumberRing(words), deque(range(11))
    found = []
    while waiting:
        ours.put(waiting)
        found.append(theirs.take())
    assert found == [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10]]
    assert theirs.take() == []
