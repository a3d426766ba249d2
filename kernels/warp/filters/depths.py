"""Images of 8 and 16 bits as floats, and back, in Warp: one thread per slab, or per element."""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, slabs, view

from . import _depths_cpu as cpu
from . import _depths_cuda as cuda

_ROW = 1 << 12  # elements that are a row to a slab


def widen(src: wp.array, dst: wp.array) -> None:
    """Convert uint8 or uint16 to float32."""
    _convert(cpu.widens[src.dtype], cuda.widens[src.dtype], src, dst)


def narrow(src: wp.array, dst: wp.array) -> None:
    """Round float32 to uint8 or uint16: half to even, beyond the limits to them, NaN to 0."""
    _convert(cpu.narrows[dst.dtype], cuda.narrows[dst.dtype], src, dst)


def _convert(of_rows: wp.Kernel, of_elements: wp.Kernel, src: wp.array, dst: wp.array) -> None:
    size = src.size
    if dst.device.is_cuda:
        launch(of_elements, size, [view(src, src.dtype, (size,))], [view(dst, dst.dtype, (size,))])
        return
    whole = size // _ROW
    for begin, shape in ((0, (whole, _ROW)), (whole * _ROW, (1, size - whole * _ROW))):
        if shape[0] * shape[1]:
            one, other = (_part(a, begin, shape) for a in (src, dst))
            launch_slabs(of_rows, shape[0], slabs(shape[0], shape[0] * shape[1]), [one], [other])


def _part(array: wp.array, begin: int, shape: tuple[int, int]) -> wp.array:
    """View elements from `begin` on as rows."""
    flat = view(array, array.dtype, (array.size,))
    return view(flat[begin : begin + shape[0] * shape[1]], array.dtype, shape)
