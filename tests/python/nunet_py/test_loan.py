"""Loans: images that are written directly into shared memory and never change after they were sent."""

import contextlib
import ctypes
import gc
import types

import numpy as np
import nunet_py as nunet
import pytest
from streaming import address, attached, mapping, run_python, unique_name
from support import hint_of

SIZE = (64, 48)
SHAPE = (48, 64, 3)


def noise(shape=SHAPE, seed=0):
    return np.random.default_rng(seed).integers(0, 256, shape, np.uint8)


def test_a_loan_is_the_memory_that_readers_see(pair):
    publisher, frames = pair
    with publisher.loan() as image:
        assert (image.shape, image.dtype, image.flags.writeable) == (SHAPE, np.uint8, True)
        image[:] = noise()
        path, inode, offset = mapping(address(image))
        assert path.startswith("/dev/shm/")
        assert frames.latest() is None, "nothing is sent before the end of the block"
    frame = frames.next()
    assert np.array_equal(frame.rgb, noise())
    assert mapping(address(frame.rgb))[1:] == (inode, offset), "the same bytes of the same file"
    assert publisher.copied == 0


def test_the_array_of_a_loan_is_read_only_after_it_was_sent(pair):
    publisher, frames = pair
    with publisher.loan() as image:
        image[:] = 1
    with pytest.raises(ValueError, match="read-only"):
        image[0] = 2
    with pytest.raises(ValueError, match="WRITEABLE"):
        image.flags.writeable = True
    with pytest.raises(ValueError, match="read-only"):
        image[::2][0] = 2
    assert (frames.next().rgb == 1).all()


def interface(array):
    """A writeable array over the same memory that numpy does not treat as a view of the array."""
    return np.asarray(types.SimpleNamespace(__array_interface__=array.__array_interface__, base=array))


# What keeps a reference to `image`, and what happens to the variable of the block. A reference that is the
# only one left is taken for that variable.
KEEPS = {
    "view": lambda image: image[..., 0],
    "flat view": lambda image: image.reshape(-1),
    "memoryview": memoryview,
    "ctypes": lambda image: (ctypes.c_uint8 * image.nbytes).from_buffer(image),
    "interface": interface,
    "list": lambda image: [image],
}
VIEWS = ["view", "flat view"]
KEPT = [(keep, "kept") for keep in KEEPS] + [
    (keep, name) for keep in VIEWS for name in ("deleted", "rebound")
]


def write(kept):
    """Writes through what was kept, if it allows that."""
    if isinstance(kept, list):
        with pytest.raises(ValueError, match="read-only"):
            kept[0][:] = 9
    elif isinstance(kept, memoryview):
        kept[0, 0, 0] = 9
    else:
        kept[0] = 9


@pytest.mark.parametrize(("keep", "name"), KEPT)
def test_references_that_are_kept_cannot_change_what_was_sent(pair, keep, name):
    publisher, frames = pair
    with publisher.loan() as image:
        image[:] = 1
        kept = KEEPS[keep](image)
        if name == "deleted":
            del image
        elif name == "rebound":
            image = kept
    assert publisher.copied == 1
    frame = frames.next()
    write(kept)
    assert (frame.rgb == 1).all()
    del kept
    image = None
    with publisher.loan() as image:
        image[:] = 2
    assert (frames.next().rgb == 2).all() and publisher.copied == 1


@pytest.mark.parametrize("keep", VIEWS)
def test_views_from_an_exit_stack_cannot_change_what_was_sent(pair, keep):
    publisher, frames = pair
    with contextlib.ExitStack() as stack:
        kept = KEEPS[keep](stack.enter_context(publisher.loan()))
        kept[:] = 1
    assert publisher.copied == 1
    frame = frames.next()
    before = frame.rgb.copy()
    write(kept)
    assert np.array_equal(frame.rgb, before)


def test_a_second_variable_costs_a_copy(pair):
    publisher, frames = pair
    with publisher.loan() as image:
        image[:] = 1
        same = image
    assert publisher.copied == 1 and not same.flags.writeable
    assert (frames.next().rgb == 1).all()


def variables_of_a_function(publisher, other):
    with publisher.loan() as left, other.loan() as right:
        left[:], right[:] = 1, 2


def variables_of_a_closure(publisher, other):
    with publisher.loan() as left, other.loan() as right:
        left[:], right[:] = 1, 2
    return lambda: (left, right)


def variables_of_a_module(publisher, other):
    code = "with publisher.loan() as left, other.loan() as right:\n    left[:], right[:] = 1, 2\n"
    exec(code, {"publisher": publisher, "other": other})


def variables_below_an_exit_stack(publisher, other):
    with contextlib.ExitStack() as stack:
        left, right = stack.enter_context(publisher.loan()), stack.enter_context(other.loan())
        left[:], right[:] = 1, 2


VARIABLES = [
    variables_of_a_function,
    variables_of_a_closure,
    variables_of_a_module,
    variables_below_an_exit_stack,
]


@pytest.mark.parametrize("use", VARIABLES, ids=lambda use: use.__name__)
def test_one_variable_costs_no_copy(use):
    with attached() as (publisher, frames), attached() as (other, others):
        for _ in range(5):
            use(publisher, other)
            assert (frames.next().rgb == 1).all() and (others.next().rgb == 2).all()
        assert (publisher.copied, other.copied) == (0, 0)


def test_a_loop_of_loans_copies_nothing(pair):
    publisher, frames = pair
    for value in range(50):
        with publisher.loan() as image:
            image[:] = value
        assert frames.next().rgb[-1, -1, -1] == value
    assert publisher.copied == 0


def test_a_block_that_fails_sends_nothing_and_releases_its_memory(pair):
    publisher, frames = pair
    for _ in range(20):
        with pytest.raises(ZeroDivisionError), publisher.loan() as image:
            image[:] = 1 // 0
    assert frames.latest() is None
    assert publisher.publish(noise()) == 0


def test_the_time_of_capture_may_be_set_inside_of_the_block(pair):
    publisher, frames = pair
    loan = publisher.loan()
    with loan:
        loan.capture_nanos = 123
    assert frames.next().header.capture_nanos == 123
    with loan, pytest.raises(nunet.NunetError, match="already open"):
        loan.__enter__()


def test_arrays_of_earlier_loans_that_hold_all_memory_are_a_clear_error(pair):
    publisher, frames = pair
    held = []
    with pytest.raises(nunet.NunetError, match="arrays of earlier loans hold it") as error:
        for _ in range(20):
            with publisher.loan() as image:
                held.append(image[..., 0])
    hint_of(error)
    held.clear()
    del image, error
    gc.collect()
    publisher.publish(noise())
    assert np.array_equal(frames.next().rgb, noise())


def test_closing_inside_of_a_loan_is_an_error_at_its_end():
    publisher = nunet.publisher(unique_name(), size=SIZE)
    with pytest.raises(nunet.NunetError, match="is closed"), publisher.loan() as image:
        publisher.close()
        image[:] = 1
    assert (image == 1).all()


def test_arrays_of_a_loan_can_be_read_after_the_publisher_is_gone():
    code = (
        "import sys, gc, nunet_py\n"
        "publisher = nunet_py.publisher(sys.argv[1], size=(64, 48))\n"
        "with publisher.loan() as image:\n"
        "    image[:] = 7\n"
        "with publisher.loan() as other:\n"
        "    view = other[..., 1]\n"
        "    view[:] = 8\n"
        "publisher.close()\n"
        "del publisher\n"
        "gc.collect()\n"
        "view[0] = 9\n"
        "print(int(image.sum()), int(view[1:].sum()))\n"
    )
    ended = run_python(code, unique_name(), check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, f"{48 * 64 * 3 * 7} {47 * 64 * 8}\n", "")
