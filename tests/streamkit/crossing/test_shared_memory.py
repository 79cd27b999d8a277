"""Slots: arrays in shared memory keep values, layout and life."""

import gc
import os

import numpy as np
import pytest

from streamkit.crossing.shared_memory import SlotReader, SlotWriter, make_numbers, map_numbers


def pass_on(writer: SlotWriter, reader: SlotReader, array: np.ndarray) -> np.ndarray:
    """The array as the reader sees it."""
    place, made = writer.write(array)
    if made is not None:
        reader.add(*made)
    return reader.read(place)


def give_back(writer: SlotWriter, reader: SlotReader) -> int:
    """Tells the writer which slots are free; returns their number."""
    gc.collect()
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


def test_no_descriptor_stays_open() -> None:
    """Memory is mapped without one, whatever the number of frames kept."""
    before = len(os.listdir("/proc/self/fd"))
    writer, reader = SlotWriter(), SlotReader()
    kept = []
    for value in range(50):
        place, made = writer.write(np.full((8, 8), value, np.uint8))
        assert made is not None
        reader.add(made.number, made.size, os.dup(made.descriptor))
        os.close(made.descriptor)
        kept.append(reader.read(place))
    assert len(os.listdir("/proc/self/fd")) == before
    assert all(np.all(array == value) for value, array in enumerate(kept))


def test_memory_that_could_shrink_is_refused() -> None:
    """The other process could end this one by it."""
    descriptor = os.memfd_create("test")
    os.ftruncate(descriptor, 100)
    with pytest.raises(ValueError, match="sealed"):
        SlotReader().add(0, 100, descriptor)


@pytest.mark.parametrize(
    ("dtype", "shape", "strides"),
    [("|u1", (101,), (1,)), ("|O", (1,), (8,)), ("|u1", (5,), (-1,)), ("|u1", (2**40,), (0,))],
)
def test_a_place_outside_the_slot_is_refused(dtype: str, shape: tuple, strides: tuple) -> None:
    """Whatever the other process says, only its memory is read."""
    writer, reader = SlotWriter(), SlotReader()
    place, made = writer.write(np.zeros(100, np.uint8))
    assert made is not None
    reader.add(*made)
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
