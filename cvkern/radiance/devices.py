"""Training on several devices: each renders rays of its own, and all learn from one sum.

After the backward pass, the gradients of all devices are added up. Every device gets the same bits,
so the parameters stay equal. On GPUs, NCCL adds, through CuPy or PyTorch, whichever is installed;
without them, and on the CPU, the host does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np

from cvkern._arrays import library
from cvkern._runtime import Runtime

Add = Callable[[Sequence[Sequence[Any]]], None]
"""Called with a list of arrays for each device; replaces each by the sum over the devices.

Bytes are marks: of these, the largest is kept.
"""


def adder(runtimes: Sequence[Runtime]) -> Add:
    """Return a function that adds arrays over devices."""
    devices = [rt.device for rt in runtimes]
    if len(set(devices)) == len(devices) > 1 and "cpu" not in devices:
        if find_spec("cupy") and import_module("cupy.cuda.nccl").available:
            return _by_cupy(runtimes)
        if find_spec("torch"):
            return _by_torch(runtimes)
    return _on_host(runtimes)


def _on_host(runtimes: Sequence[Runtime]) -> Add:
    def add(arrays: Sequence[Sequence[Any]]) -> None:
        for same in zip(*arrays, strict=True):
            values = [rt.to_numpy(a) for rt, a in zip(runtimes, same, strict=True)]
            rule = np.maximum if values[0].dtype == np.uint8 else np.add
            found = rule.reduce(values)
            for rt, array in zip(runtimes, same, strict=True):
                rt.write(array, found)

    return add


def _by_cupy(runtimes: Sequence[Runtime]) -> Add:
    nccl = import_module("cupy.cuda.nccl")
    communicators = nccl.NcclCommunicator.initAll([_index(rt.device) for rt in runtimes])

    def add(arrays: Sequence[Sequence[Any]]) -> None:
        streams = [rt.stream() for rt in runtimes]
        nccl.groupStart()
        for same in zip(*arrays, strict=True):
            marks = library(same[0]).dtype(same[0]) == np.uint8
            kind = nccl.NCCL_UINT8 if marks else nccl.NCCL_FLOAT32
            rule = nccl.NCCL_MAX if marks else nccl.NCCL_SUM
            for rt, to, stream, array in zip(runtimes, communicators, streams, same, strict=True):
                at, _ = library(array).memory(array, rt.device)
                to.allReduce(at, at, math.prod(array.shape), kind, rule, stream)
        nccl.groupEnd()

    return add


def _by_torch(runtimes: Sequence[Runtime]) -> Add:
    torch = import_module("torch")
    largest = 2  # ncclMax

    def add(arrays: Sequence[Sequence[Any]]) -> None:
        streams = [torch.cuda.ExternalStream(rt.stream(), device=rt.device) for rt in runtimes]
        for same in zip(*arrays, strict=True):
            tensors = [
                torch.as_tensor(a, device=rt.device) for rt, a in zip(runtimes, same, strict=True)
            ]
            marks = tensors[0].dtype == torch.uint8
            torch.cuda.nccl.all_reduce(
                tensors, op=largest if marks else torch.cuda.nccl.SUM, streams=streams
            )

    return add


def _index(device: str) -> int:
    return int(device.partition(":")[2])
