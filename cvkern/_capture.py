"""Repeated calls on the same arrays, with the work of Python done once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cvkern._runtime import pinned, runtime
from cvkern._tape import taped


def capture(function: Callable[..., Any], *args: Any, **options: Any) -> Callable[[], Any]:
    """Record a call, to repeat it on whatever its arrays hold by then.

    The call is made once. What comes back repeats it: on CUDA with Warp as one graph launch, else
    as the same kernels again, into the same memory.

    Parameters
    ----------
    function : callable
        A function of cvkern, or one that calls several. It must be kernels alone: not
        :func:`subpixel_edges` or :func:`median`, which look at values or convert dtypes outside
        of kernels.
    *args, **options
        Its arguments. Arrays are read again at each repetition, where they are: fill them in
        place. On a GPU they must be contiguous, of the dtype that `function` computes in, and of
        a library that can write to its arrays (so not JAX, nor NumPy sent there by :class:`use`).

    Returns
    -------
    callable
        Takes no arguments and returns what `function` returned: the same arrays each time, newly
        filled; on a GPU they are filled on the caller's current stream. Not for two threads at
        once.

    Raises
    ------
    ValueError
        If the function or its arrays are none of those above.

    Examples
    --------
    >>> import numpy as np
    >>> import cvkern
    >>> frame = np.zeros((4, 6), np.uint8)
    >>> find_edges = cvkern.capture(cvkern.canny, frame, 1.0)
    >>> frame[:, 3:] = 255
    >>> int(find_edges().sum())
    4
    """
    arrays = [a for a in (*args, *options.values()) if hasattr(a, "shape")]
    rt = runtime(*arrays)
    choice = pinned()
    results: list[Any] = []
    constants: list[Any] = []
    scratch: dict[Any, Any] = {}

    with rt.own_scratch(scratch), taped(results, constants):
        result = function(*args, **options)

    def again() -> None:
        with choice(), rt.own_scratch(scratch), taped(results, constants, replay=True):
            function(*args, **options)

    repeat = rt.record(again)

    def replay() -> Any:
        with choice():
            runtime(*arrays)  # the caller's stream, as it is now
        repeat()
        return result

    return replay
