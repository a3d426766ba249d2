"""Argument checks for all public functions: each rule and its message stand here once."""

from __future__ import annotations

import math
import operator
import os
from collections.abc import Mapping, Sequence, Set
from enum import IntEnum
from functools import lru_cache
from numbers import Number
from typing import Any, TypeVar

import numpy as np

from cvkern import _arrays

E = TypeVar("E", bound=IntEnum)

# Kernels index bytes with 32 bits, so an array has at most 2^29 elements of four bytes.
MAX_ELEMENTS = 2**29
MAX_SIDE = 2**16  # pixels along one side of an image whose points vote
MAX_DISPARITIES = 2**15
FLOAT32_MAX = float(np.finfo(np.float32).max)
READERS = {"Model": "load_model", "Scene": "load_scene"}  # what reads an object from a file


def check_image(
    image: Any, *, ndim: tuple[int, ...] = (2,), name: str = "image", most: int = MAX_ELEMENTS
) -> Any:
    """Return `image` as an array of real values; check its rank, and that no axis is empty."""
    library = _arrays.library(image, name)
    image = as_array(image, name)
    dtype = library.dtype(image)
    if dtype.kind not in "biuf":
        raise TypeError(f"{name} must hold real numbers, got dtype {dtype}")
    if not dtype.isnative:
        image = library.native(image)
    shape = tuple(image.shape)
    if len(shape) not in ndim:
        want = " or ".join(f"{n}-D" for n in ndim)
        raise ValueError(f"{name} must be {want}, got shape {shape}")
    if 0 in shape:
        raise ValueError(f"{name} must not be empty, got shape {shape}")
    if math.prod(shape) > most:
        raise ValueError(f"{name} must have at most {most} elements, got shape {shape}")
    return image


def check_rgb(image: Any, name: str = "image") -> Any:
    """Return an image of red, green and blue, (H, W, 3), as an array."""
    image = check_image(image, ndim=(2, 3, 4), name=name)
    shape = tuple(image.shape)
    if len(shape) != 3 or shape[2] != 3:
        raise ValueError(f"{name} must have shape (H, W, 3), got {shape}")
    return image


def check_photograph(image: Any, name: str = "image", batch_axis: int | None = None) -> Any:
    """Return a photograph as an array: grey (H, W), or with 3 or 4 channels along the last axis.

    With `batch_axis` 0 it is a stack of photographs.
    """
    if batch_axis is not None:
        check_integer(batch_axis, "batch_axis", 0, 0)
        image = check_image(image, ndim=(3, 4), name=name)
        if len(image.shape) == 4 and image.shape[3] not in (3, 4):
            shape = tuple(image.shape)
            raise ValueError(f"{name} must have shape (N, H, W) or (N, H, W, 3 or 4), got {shape}")
        return image
    image = check_image(image, ndim=(2, 3), name=name)
    shape = tuple(image.shape)
    if len(shape) == 3 and shape[2] not in (3, 4):
        raise ValueError(f"{name} must have shape (H, W) or (H, W, 3 or 4), got {shape}")
    return image


def as_array(values: Any, name: str) -> Any:
    """Convert lists, buffers and data frames by NumPy; return arrays unchanged."""
    if type(values) is np.ndarray or _arrays.library(values, name) is not _arrays.NUMPY:
        return values
    try:
        return np.asarray(values)
    except ValueError as error:
        raise ValueError(f"{name} must be rectangular, got rows that differ: {error}") from None
    except Exception as error:  # another library may raise anything when asked for its values
        got = f"{type(values).__name__}: {error}"
        raise TypeError(f"{name} must be an array that NumPy can read, got {got}") from None


def as_numbers(values: Any, name: str, dtype: Any = np.float64) -> np.ndarray:
    """Convert `values` to a host array of `dtype`, or refuse them."""
    _arrays.library(values, name)  # refuses masks and placeholders
    try:
        array = np.asarray(values)
        # Texts, dates and None would be converted too.
        if array.dtype.kind == "O":
            numeric = all(isinstance(value, Number) for value in array.flat)
        else:
            numeric = array.dtype.kind not in "SUmM" and np.isrealobj(array)
        if numeric:
            with np.errstate(over="ignore"):
                return array.astype(dtype)
    except Exception:  # another library may raise anything when asked for its values
        pass
    raise TypeError(f"{name} must be real numbers, got {_brief(values)}")


def _brief(value: Any) -> str:
    """Return a value as text of at most 80 characters, for a message."""
    said = " ".join(repr(value).split())
    return said if len(said) <= 80 else f"{said[:77]}..."


def as_items(values: Any, name: str, rule: str) -> tuple[Any, ...]:
    """Return the items of a sequence; `rule` describes them in the message.

    Text and mappings are no sequences, and sets have no order. The items of a data frame are its
    rows: when it is iterated, it gives the names of its columns.
    """
    try:
        if isinstance(values, (str, bytes, bytearray, Mapping, Set)):
            raise TypeError
        # The items of a buffer would be Python's, of an array NumPy's: True is an integer or not.
        if isinstance(values, memoryview) or _is_frame(values):
            values = np.asarray(values)
        return tuple(values)
    except Exception:  # another library may raise anything when asked for its values
        raise TypeError(f"{name} must be {rule}, got {_brief(values)}") from None


def _is_frame(values: Any) -> bool:
    """Tell whether NumPy reads an object that is no array of a library."""
    known = isinstance(values, (list, tuple, np.ndarray)) or not hasattr(values, "__array__")
    return not known and _arrays.library(values) is _arrays.NUMPY


def check_rows_columns(shape: Any, of: str) -> tuple[Any, Any]:
    """Return the two items of a shape; `of` names the counted things in the message."""
    try:
        rows, columns = as_items(shape, "shape", "rows and columns")
    except (TypeError, ValueError):
        raise ValueError(f"shape must be rows and columns of {of}, got {_brief(shape)}") from None
    return rows, columns


def check_sides(shape: Any, name: str, least: int = 1) -> tuple[int, int]:
    """Return height and width, each small enough for the voting kernels."""
    given = as_items(shape, name, "a height and a width")
    sides = tuple(check_integer(n, name, least, MAX_SIDE) for n in given)
    if len(sides) != 2:
        raise ValueError(f"{name} must be a height and a width, got {len(sides)} numbers")
    return sides


def check_accumulator(shape: tuple[int, ...], name: str) -> None:
    """Refuse an accumulator of int32 votes with more elements than kernels can index."""
    size = math.prod(shape)
    if size > MAX_ELEMENTS:
        raise ValueError(
            f"{name} must have at most {MAX_ELEMENTS} elements, got {size} in shape "
            f"{tuple(shape)}, which would take {4 * size} bytes"
        )


def check_dtype(array: Any, dtype: Any, name: str) -> None:
    """Refuse an array of any dtype but one."""
    given = _arrays.library(array).dtype(array)
    if given != np.dtype(dtype):
        raise TypeError(f"{name} must be {np.dtype(dtype)}, got {given}")


def check_beside(values: Any, shape: tuple[int, ...], name: str) -> Any:
    """Return `values` as an array of `shape`, that of the mask or the points; None stays None."""
    if values is None:
        return None
    values = as_array(values, name)
    if tuple(values.shape) != tuple(shape):
        raise ValueError(f"{name} must have shape {tuple(shape)}, got {tuple(values.shape)}")
    return check_image(values, ndim=(1, 2, 3), name=name) if len(values) else values


def check_channel_axis(shape: tuple[int, ...], channel_axis: int | None) -> int | None:
    """Return the axis that is not filtered, counted from the front, or None."""
    if (len(shape) == 3) != (channel_axis is not None):
        raise ValueError(
            f"channel_axis must be given for 3-D images and for no others, "
            f"got {channel_axis} for shape {tuple(shape)}"
        )
    if channel_axis is None:
        return None
    return check_integer(channel_axis, "channel_axis", -3, 2) % 3


def check_colors(shape: tuple[int, ...], channel_axis: int | None) -> int | None:
    """Return the axis of the channels of a photograph; without one, the last if it has 3 or 4."""
    if channel_axis is None and len(shape) == 3 and shape[2] in (3, 4):
        return 2
    return check_channel_axis(shape, channel_axis)


def check_axes(
    shape: tuple[int, ...], channel_axis: int | None, batch_axis: int | None
) -> int | None:
    """Return the axis of the channels within one image of a stack, or None."""
    if batch_axis is None:
        return check_channel_axis(shape, channel_axis)
    check_integer(batch_axis, "batch_axis", 0, 0)
    if len(shape) not in (3, 4) or (len(shape) == 4) != (channel_axis is not None):
        raise ValueError(
            f"image must have 3 axes with batch_axis, and 4 with channel_axis too, "
            f"got shape {tuple(shape)} and channel_axis {channel_axis}"
        )
    if channel_axis is None:
        return None
    axis = check_integer(channel_axis, "channel_axis", -3, 3) % 4
    if axis == 0:
        raise ValueError(f"channel_axis must differ from batch_axis, got {channel_axis}")
    return axis - 1


def check_code(value: str, codes: type[E], name: str) -> E:
    """Return the member of `codes` called `value` (the code that kernels switch on)."""
    names = _names(codes)
    code = names.get(value) if isinstance(value, str) else None
    if code is None:
        raise ValueError(f"{name} must be one of {tuple(names)}, got {value!r}")
    return code


@lru_cache
def _names(codes: type[IntEnum]) -> dict[str, Any]:
    return {code.name.lower(): code for code in codes}


def check_choice(value: str, choices: Sequence[str], name: str) -> str:
    """Return `value` if it is one of `choices`."""
    if not isinstance(value, str) or value not in choices:
        raise ValueError(f"{name} must be one of {tuple(choices)}, got {value!r}")
    return value


def check_number(value: Any, name: str, *, low: float = -math.inf, finite: bool = True) -> float:
    """Return `value` as a float of at least `low`, by default finite in float32."""
    number = value if type(value) is float else _as_float(value, name)
    if math.isnan(number) or number < low or (finite and abs(number) > FLOAT32_MAX):
        rule = "finite" if low == -math.inf else f">= {low:g}" + (" and finite" if finite else "")
        raise ValueError(f"{name} must be {rule}, got {_shown(value)}")
    return number


def check_positive(value: Any, name: str) -> float:
    """Return `value` as a float above 0, finite in float32."""
    number = check_number(value, name)
    if number <= 0:
        raise ValueError(f"{name} must be > 0, got {_shown(value)}")
    return number


def _as_float(value: Any, name: str) -> float:
    _arrays.library(value, name)
    try:
        if not isinstance(value, (str, bytes)) and np.ndim(value) == 0 and np.isrealobj(value):
            return float(value)
    except OverflowError:  # a Python integer too large for a float
        return math.inf if value > 0 else -math.inf  # pyright: ignore[reportOperatorIssue]
    except (TypeError, ValueError):
        pass
    raise TypeError(f"{name} must be a number, got {value!r}")


def _shown(value: Any) -> str:
    """Return a number as text for a message; a Python integer may have thousands of digits."""
    if isinstance(value, int) and abs(value) >= 10**40:
        return f"an integer of {value.bit_length()} bits"
    return str(value)


def check_integer(value: Any, name: str, low: int, high: int) -> int:
    """Return `value` as an int in [low, high]."""
    if type(value) is not int:
        _arrays.library(value, name)  # refuses masks and placeholders
    try:
        number = int(operator.index(value))  # True is 1
    except TypeError:
        raise TypeError(f"{name} must be an integer, got {value!r}") from None
    if not low <= number <= high:
        raise ValueError(f"{name} must be in [{low}, {high}], got {_shown(value)}")
    return number


def check_instance(value: Any, kind: type, name: str) -> None:
    """Refuse a value that is not an instance of a class, and name the reader of a file of it."""
    if not isinstance(value, kind):
        reader = READERS.get(kind.__name__) if isinstance(value, (str, os.PathLike)) else None
        hint = f": {reader} reads one" if reader else ""
        raise TypeError(f"{name} must be a {kind.__name__}, got {type(value).__name__}{hint}")


def refuse_masks(**options: Any) -> None:
    """Refuse masked arrays among options that a call ignores, and so does not check further."""
    for name, value in options.items():
        _arrays.library(value, name)


def check_flag(value: Any, name: str) -> bool:
    """Return `value` as a bool if it is True or False of Python or NumPy; refuse others."""
    if not isinstance(value, bool):
        _arrays.library(value, name)  # refuses masks and placeholders
    if isinstance(value, (bool, np.bool_)) or (isinstance(value, int) and value in (0, 1)):
        return bool(value)
    raise TypeError(f"{name} must be True or False, got {value!r}")


def check_pair(value: Any, name: str) -> tuple[Any, Any]:
    """Return a pair, for the rows and the columns: one value twice, or the two values given."""
    if isinstance(value, (int, float)):
        return value, value
    _arrays.library(value, name)  # refuses masks and placeholders
    try:
        if np.ndim(value) == 0:
            return value, value
    except ValueError:  # two arrays of different shapes
        pass
    values = as_items(value, name, "one number or two")
    if len(values) != 2:
        raise ValueError(f"{name} must be one number or two, got {len(values)}")
    return values[0], values[1]


def check_disparities(disparities: Any, width: int) -> tuple[int, int]:
    """Return the first disparity and the one after the last, for images of `width` columns."""
    try:
        given = as_items(disparities, "disparities", "two integers")
        first, stop = (operator.index(d) for d in given)
    except Exception:  # another library may raise anything when asked for its values
        raise TypeError(
            f"disparities must be two integers, the first and the one after the last, "
            f"got {_brief(disparities)}"
        ) from None
    if first >= stop:
        raise ValueError(f"disparities must be (first, stop) with first < stop, got {first, stop}")
    if first <= -width or stop > width:
        raise ValueError(
            f"disparities must be less than the width of {width} pixels, got {first, stop}"
        )
    if stop - first > MAX_DISPARITIES:
        raise ValueError(
            f"disparities must be at most {MAX_DISPARITIES}, got {first, stop}: {stop - first}"
        )
    return first, stop


def check_depth(dtype: Any) -> np.dtype:
    """Return the dtype of a result in floats or in bytes, or refuse another."""
    try:
        dtype = np.dtype(dtype)
    except Exception:  # NumPy says of some that they are out of use
        raise TypeError(f"dtype must be float32 or uint8, got {dtype!r}") from None
    if dtype not in (np.dtype(np.float32), np.dtype(np.uint8)):
        raise ValueError(f"dtype must be float32 or uint8, got {dtype}")
    return dtype


def check_out(out: Any, image: Any, dtype: Any) -> None:
    """Refuse `out` unless it is an array like `image`, of `dtype`, in other memory."""
    if out is None:
        return
    library = _arrays.library(out)
    if library is not _arrays.library(image) or not hasattr(out, "shape"):
        raise TypeError(f"out must be an array like the image, got {type(out).__name__}")
    if not library.writable:
        raise TypeError(f"out must be an array that can be written to, got {type(out).__name__}")
    if tuple(out.shape) != tuple(image.shape):
        raise ValueError(f"out must have shape {tuple(image.shape)}, got {tuple(out.shape)}")
    if library.dtype(out) != np.dtype(dtype):
        raise TypeError(f"out must be {np.dtype(dtype)}, got {out.dtype}")
    place, wanted = _arrays.device(out), _arrays.device(image)
    if place != wanted:
        raise ValueError(f"out must be on the device of the image, {wanted}, got {place}")
    writeable = not isinstance(out, np.ndarray) or out.flags.writeable
    # Its own dtype is given: NumPy copies to an equal dtype that is another object.
    if library.contiguous(out, library.dtype(out)) is not out or not writeable:
        raise ValueError("out must be contiguous and writeable, got an array that is not")
    if _share_memory(out, image, place):
        raise ValueError("out must not share memory with the image, got one that does")


def _share_memory(out: Any, image: Any, device: str) -> bool:
    if device == "cpu":
        return np.may_share_memory(np.asarray(out), np.asarray(image))
    # On a GPU, test whether one begins within the other. A strided image is copied first.
    begins = [_arrays.library(a).memory(a, device)[0] for a in (out, image)]
    sizes = [math.prod(a.shape) * _arrays.library(a).dtype(a).itemsize for a in (out, image)]
    return begins[0] < begins[1] + sizes[1] and begins[1] < begins[0] + sizes[0]
