"""
A call recorded for a video
===========================

`capture` records a call on given arrays and repeats it later on their new contents. With Warp on
CUDA, each repetition is one graph launch. Here the video is a moving window of a photograph.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage import data

import cvkern
from cvkern.images import luma

wide = luma(data.astronaut()).astype(np.uint8)
frame = np.ascontiguousarray(wide[:256, :256])
find_edges = cvkern.capture(cvkern.canny, frame, 1.5)

figure, axes = plt.subplots(2, 4, figsize=(6, 3.1))
for shift, (above, below) in zip((0, 60, 120, 180), axes.T):
    frame[:] = wide[shift : shift + 256, shift : shift + 256]
    above.imshow(frame, cmap="gray")
    below.imshow(find_edges(), cmap="gray_r", interpolation="antialiased")
    above.axis("off")
    below.axis("off")
plt.show()
