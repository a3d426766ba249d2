"""Random arguments: most are right, some are at the limits, and some are nonsense."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import cvkern

LARGEST = 3.4e38  # nearly the end of float32
Maker = Callable[["Draw"], Any]
MODES = ["reflect", "constant", "nearest", "mirror", "wrap"]
DTYPES = [
    "bool",
    "int8",
    "uint8",
    "uint8",
    "int16",
    "uint16",
    "int32",
    "uint32",
    "int64",
    "uint64",
    "float16",
    "float32",
    "float32",
    "float64",
]
NONSENSE: list[Any] = [
    None,
    "a",
    b"a",
    math.nan,
    math.inf,
    -math.inf,
    -1,
    0,
    1,
    2**31,
    -(2**40),
    10**400,
    1e-320,
    1e300,
    -0.0,
    3.5,
    True,
    1 + 2j,
    np.complex128(2),
    np.uint8(2),
    np.int64(3),
    np.float32(0.5),
    [],
    [1],
    (1, 2),
    [1, [2]],
    {},
    np.zeros(0),
    np.zeros((0, 3)),
    np.array(2),
    np.ones((2, 2, 2, 2)),
    object(),
    np.array(["x"]),
    memoryview(b"abc"),
    range(3),
    np.datetime64("2020-01-01"),
    np.ma.masked_array([1.0, 2.0], [True, False]),
    "reflect",
]


class Draw(NamedTuple):
    """One call's random numbers, and the shape that its arrays share."""

    rng: np.random.Generator
    shape: tuple[int, int]
    salt: int = 0  # what arguments that belong together are drawn with

    def pick(self, values: Any) -> Any:
        """Return one of the values."""
        return values[int(self.rng.integers(len(values)))]

    def odd(self, share: float) -> bool:
        """Return True in this share of all cases."""
        return bool(self.rng.random() < share)


def alike(draw: Draw) -> Draw:
    """Return numbers that are the same for each argument of a call."""
    return Draw(np.random.default_rng((*draw.shape, draw.salt)), draw.shape, draw.salt)


class Call(NamedTuple):
    """A function, makers of its arguments, and whether both kernel sets give the same bits.

    `equal` may be a device, the only one on which they do.

    `but` tells of arguments for which the sets may differ, as their documentation says.
    """

    function: Callable[..., Any]
    needed: dict[str, Maker]
    options: dict[str, Maker]
    equal: bool | str = True
    but: Callable[[dict[str, Any]], bool] = lambda arguments: False


def begin(seed: int, index: int) -> Draw:
    """Return the random state of the call of this number."""
    rng = np.random.default_rng((seed, index))
    sides = [int(n) for n in rng.choice([1, 1, 2, 3, 5, 8, 17, 33, 40, 64, 70, 130], 2)]
    return Draw(rng, (sides[0], sides[1]), int(rng.integers(2**31)))


def image(draw: Draw, shape: tuple[int, ...] | None = None) -> Any:
    """Return an array of any dtype, layout and content."""
    rng, shape = draw.rng, draw.shape if shape is None else shape
    if draw.odd(0.02):
        shape = tuple(int(n) for n in rng.integers(0, 6, rng.integers(0, 5)))
    dtype = np.dtype(draw.pick(DTYPES))
    kind = draw.pick(["noise", "noise", "steps", "flat", "sparse", "few"])
    values = rng.random(shape)
    if kind == "steps" and len(shape) == 2:
        y, x = np.indices(shape)
        values = ((y // 7 + x // 9) % 3) / 3
    elif kind == "flat":
        values = np.full(shape, rng.random())
    elif kind == "sparse":
        values = values * (values > 0.9)
    elif kind == "few":
        values = np.round(3 * values) / 3
    array: Any
    if dtype.kind == "f":
        array = (
            (values * draw.pick([1, 1, 1, 1, 255, 255, 1e-5, 1e30, LARGEST])).astype(dtype)
            if dtype.itemsize > 2
            else values.astype(dtype)
        )
        if draw.odd(0.15) and array.size and array.ndim:
            array.reshape(-1)[rng.integers(array.size, size=3)] = draw.pick(
                [np.nan, np.inf, -np.inf, -0.0]
            )
    elif dtype.kind == "b":
        array = values > 0.5
    else:
        array = (values * min(np.iinfo(dtype).max, 2.0**62)).astype(dtype)
    array = np.asarray(array)
    layout = draw.rng.random()
    if layout < 0.08:
        array = np.asfortranarray(array)
    elif layout < 0.14:
        array = array[::-1] if array.ndim else array
    elif layout < 0.18:
        array = np.repeat(array, 2, axis=-1)[..., ::2] if array.ndim else array
    elif layout < 0.22:
        array = array.astype(array.dtype.newbyteorder())
    elif layout < 0.25:
        array = array.tolist()
    return array


def mask(draw: Draw) -> Any:
    """Return an array with few pixels set, mostly bool."""
    if draw.odd(0.2):
        return image(draw)
    return draw.rng.random(draw.shape) < draw.pick([0.0, 0.02, 0.2, 1.0])


def angles(draw: Draw, size: Any = None) -> Any:
    """Return float32 angles, of the shared shape if not told otherwise."""
    found = draw.rng.uniform(-4, 4, draw.shape if size is None else size)
    if draw.odd(0.03) and found.size:
        found.reshape(-1)[0] = np.nan
    return found.astype(draw.pick(["float32", "float64"]))


def number(low: float, high: float) -> Callable[[Draw], Any]:
    """Return a maker of numbers, now and then at the ends, or one of NumPy's."""

    def make(draw: Draw) -> Any:
        value = draw.pick([low, high]) if draw.odd(0.1) else float(draw.rng.uniform(low, high))
        return np.float32(value) if draw.odd(0.1) else value

    return make


def whole(low: int, high: int) -> Callable[[Draw], Any]:
    """Return a maker of integers."""

    def make(draw: Draw) -> Any:
        value = int(draw.rng.integers(low, high + 1))
        return (
            draw.pick([np.int64, np.uint8, np.int32])(value)
            if draw.odd(0.1) and 0 <= value < 256
            else value
        )

    return make


def one(*values: Any) -> Callable[[Draw], Any]:
    """Return a maker of one of these."""
    return lambda draw: draw.pick(values)


def maybe(make: Callable[[Draw], Any]) -> Callable[[Draw], Any]:
    """Return a maker of something, or of None."""
    return lambda draw: None if draw.odd(0.3) else make(draw)


def several(make: Callable[[Draw], Any], least: int = 1, most: int = 6) -> Callable[[Draw], Any]:
    """Return a maker of lists."""
    return lambda draw: [make(draw) for _ in range(int(draw.rng.integers(least, most + 1)))]


def pair(make: Callable[[Draw], Any]) -> Callable[[Draw], Any]:
    """Return a maker of one value, or two."""
    return lambda draw: (make(draw), make(draw)) if draw.odd(0.4) else make(draw)


def rows(columns: int) -> Callable[[Draw], Any]:
    """Return a maker of rows of numbers about the image."""

    def make(draw: Draw) -> Any:
        count = int(draw.pick([0, 1, 2, 7, 40]))
        reach = max(draw.shape) * draw.pick([1, 1, 1, 3, 1e6])
        return draw.rng.uniform(-0.2 * reach, reach, (count, columns))

    return make


def points(draw: Draw) -> Any:
    """Return points in the image."""
    count = int(draw.pick([0, 1, 2, 30]))
    return draw.rng.random((count, 2)) * (np.array(draw.shape) - 1)


def table(draw: Draw) -> Any:
    """Return the table of a ring."""
    turns = np.sort(draw.rng.uniform(-np.pi, np.pi, int(draw.rng.integers(1, 40))))
    radius = draw.rng.uniform(1, 12)
    vectors = (radius * np.stack((np.sin(turns), np.cos(turns)), 1)).astype(np.float32)
    return cvkern.RTable(vectors, turns.astype(np.float32), np.array([9.0, 9.0]), (19, 19))


def costs(draw: Draw) -> Any:
    """Return matching costs, (H, W, D)."""
    depth = int(draw.pick([1, 2, 8, 16, 17, 33]))
    shape = (min(draw.shape[0], 33), min(draw.shape[1], 64), depth)
    if draw.odd(0.3):
        return draw.rng.random(shape).astype(np.float32)
    return draw.rng.integers(0, 60, shape).astype(draw.pick(["uint8", "uint16", "int32"]))


def disparity(draw: Draw) -> Any:
    """Return disparities with gaps."""
    if draw.odd(0.1):
        return image(draw)
    found = draw.rng.integers(0, 9, draw.shape).astype(np.float32)
    found[draw.rng.random(draw.shape) < 0.2] = np.nan
    return found


def channels(draw: Draw) -> Any:
    """Return an image with channels, mostly the last axis."""
    count = int(draw.pick([1, 2, 3, 3, 4]))
    shape = (count, *draw.shape) if draw.odd(0.1) else (*draw.shape, count)
    return image(draw, shape)


def many_colours(draw: Draw) -> Any:
    """Return an image with channels last, which has the shape and dtype of others of the call."""
    same = alike(draw)
    shape, dtype = (*draw.shape, same.pick([1, 2, 3, 4])), same.pick(["uint8", "uint16", "f4"])
    values = draw.rng.random(shape)
    return (values * (1 if dtype == "f4" else 255)).astype(dtype)


def guide(draw: Draw) -> Any:
    """Return an image of bytes, mostly."""
    if draw.odd(0.2):
        return image(draw)
    return draw.rng.integers(0, draw.pick([2, 256]), draw.shape).astype(np.uint8)


def one_of(*makers: Maker) -> Maker:
    """Return a maker that is one of several, at random."""
    return lambda draw: draw.pick(makers)(draw)


def place(draw: Draw) -> np.ndarray:
    """Return an array that a result may fit into."""
    shape = draw.shape if draw.odd(0.9) else draw.shape[::-1]
    return np.zeros(shape, draw.pick(["float32", "float32", "uint8", "float64"]))


def stack(draw: Draw) -> Any:
    """Return votes of several circles."""
    return draw.rng.random((int(draw.pick([1, 2])), *draw.shape)).astype(np.float32)


def colour(draw: Draw) -> Any:
    """Return a picture to draw on."""
    shape = draw.pick([draw.shape, (*draw.shape, 3), (*draw.shape, 4)])
    return draw.rng.integers(0, 256, shape).astype(np.uint8) if draw.odd(0.9) else image(draw)


def disparities(draw: Draw) -> Any:
    """Return a range that mostly fits the width."""
    width = draw.shape[1]
    first = int(draw.rng.integers(max(-3, 1 - width), 3))
    stop = first + int(draw.rng.integers(1, max(2, min(width, 33))))
    return first, (min(stop, width) if draw.odd(0.9) else stop)


def dists(draw: Draw) -> Any:
    """Return as many distances as the image has rows."""
    return np.arange(draw.shape[0]) * 1.0


def columns(draw: Draw) -> Any:
    """Return as many angles as the image has columns."""
    return np.linspace(-1.5, 1.5, draw.shape[1])


BORDER: dict[str, Maker] = {"mode": one(*MODES), "cval": number(-5, 300)}
EDGES: dict[str, Maker] = {
    "sigma": number(0, 4),
    "low_threshold": maybe(number(0, 1)),
    "high_threshold": maybe(number(0, 300)),
    "use_quantiles": one(False, False, True),
}
IMAGE: dict[str, Maker] = {"image": image}
MASK: dict[str, Maker] = {"mask": mask}
