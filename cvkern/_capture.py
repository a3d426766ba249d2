"""Repeated calls on the same arrays, without repeating the work in Python."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cvkern._runtime import pinned, runtime
from cvkern._tape import taped


def capture(function: Callable[..., Any], *args: Any, **options: Any) -> Callable[[], Any]:
    """Record a call, and repeat it later on the new contents of its arrays.

    The call is made once. The function that is returned repeats it: with Warp on CUDA by one graph
    launch, otherwise by the same kernels again. Results go into the same memory.

    Parameters
    ----------
    function : callable
        A function of cvkern, or one that calls several of them. All of its work must be done by
        kernels. This excludes :func:`subpixel_edges`, which reads values outside of kernels, and
        :func:`median` of another dtype than uint8 or above 15 x 15, which converts dtypes there.
    *args, **options
        Its arguments. Each repetition reads the same arrays again, so fill them in place. On a GPU
        they must be contiguous, of the dtype that `function` computes in, and of a library whose
        arrays can be written to. This excludes JAX, and NumPy arrays that :class:`use` sends to a
        GPU.

    Returns
    -------
    callable
        Takes no arguments and returns the results of `function`: the same arrays each time, newly
        filled. On a GPU they are filled on the caller's current stream. Two threads must not call
        it at once. CUDA records nothing while other threads use it: each repetition then launches
        the kernels anew.

    Raises
    ------
    ValueError
        If the function or its arrays are not as described above.

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
            runtime(*arrays)  # select the caller's current stream
        repeat()
        return result

    return replay
