"""The place of the items that a thread lists on CUDA: behind those of earlier threads."""

import warp as wp

from . import _native
from ._launch import BLOCK

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@_native.func_native("_ranks_cuda.cu", BLOCK=BLOCK)
def rank_in_block(count: int) -> int: ...


@_native.func_native("_ranks_cuda.cu")
def count_in_block(is_there: int) -> int: ...
