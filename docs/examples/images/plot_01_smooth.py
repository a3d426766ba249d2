"""
Smooth an image, and find its gradient
======================================

A Gaussian removes details that are smaller than itself. Its derivatives show where the photograph
gets brighter, and how fast: hue shows the direction, brightness the length.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage import data

import cvkern
from cvkern.images import apply_colormap, luma

photo = data.coffee()
smooth = cvkern.gaussian(photo, 4, channel_axis=-1)
gradient = cvkern.gradient(luma(photo), sigma=2)

hue = apply_colormap(gradient.orientation, "cyclic") / 255
bright = gradient.magnitude / np.quantile(gradient.magnitude, 0.985)
shown = hue * bright.clip(0, 1)[..., None] ** 0.7

# sphinx_gallery_thumbnail_number = 2
for picture in (smooth / 255, shown):
    plt.figure(figsize=(6, 4))
    plt.imshow(picture)
    plt.axis("off")
plt.show()
