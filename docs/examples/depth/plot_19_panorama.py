"""
A panorama from a shuffled heap
===============================

A camera turns before a photograph, and its pictures come in no order, one of them darker, with a
stranger among them. `stitch` finds which belong together, the angles between the cameras and
their focal length, makes the exposures alike, and blends.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage import data

import cvkern

photo, focal = data.coffee(), 500.0
heap = [data.chelsea()]
for degrees, light in ((12, 1.0), (-12, 1.0), (0, 0.7)):
    a = np.radians(degrees)
    turn = np.array([[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]])
    to_camera = np.array([[focal, 0, 139.5], [0, focal, 149.5], [0, 0, 1]])
    from_photo = np.linalg.inv([[focal, 0, 299.5], [0, focal, 199.5], [0, 0, 1]])
    view = cvkern.warp_perspective(
        photo, to_camera @ turn @ from_photo, (300, 280), channel_axis=-1
    )
    heap.append((light * view).astype(np.uint8))

(panorama,) = cvkern.stitch(heap, crop=True)
print("focal lengths:", panorama.focal_lengths.round(), "pixels; they are", focal)

figure, axes = plt.subplot_mosaic("abcd;eeee", figsize=(6, 5.2), height_ratios=(1, 2))
for name, image in zip("abcde", (*heap, panorama.image)):
    axes[name].imshow(image)
    axes[name].axis("off")
figure.tight_layout()
plt.show()
