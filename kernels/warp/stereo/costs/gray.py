"""What stereo matching sees of its images, in Warp."""

import warp as wp

from cvkern.kernels.warp._launch import launch, launch_slabs, slabs

from . import _gray_cpu as cpu
from . import _gray_cuda as cuda


def gray_bytes(image: wp.array, scale: float, gray: wp.array) -> None:
    """Turn an image of 1, or of 3 or more channels, into grey values of 8 bits.

    uint8 is taken as it is; float32 times `scale`, rounded, and limited to what a byte holds. Of
    channels the first three count, as red, green and blue.
    """
    if gray.device.is_cuda:
        launch(cuda.gray_bytes[image.dtype], gray.size, [image, scale], [gray])
        return
    height = gray.shape[0]
    kernel = cpu.gray_bytes[image.dtype]
    launch_slabs(kernel, height, slabs(height, image.size), [image, scale], [gray])
