"""
Specks, and the median that removes them
========================================

One pixel in six is black or white. A mean smears the specks. The median of 5 x 5 pixels picks one
of the values in the window, so edges stay where they are.
From the left: noisy, mean, median.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage import data

import cvkern

photo = data.camera()
rng = np.random.default_rng(0)
specks = rng.choice(np.array([0, 255], np.uint8), photo.shape)
noisy = np.where(rng.random(photo.shape) < 1 / 6, specks, photo)

figure, axes = plt.subplots(1, 3, figsize=(6, 4))
for ax, picture in zip(axes, (noisy, cvkern.box(noisy, 2), cvkern.median(noisy, 2))):
    print(f"off by {np.abs(picture - photo.astype(float)).mean():.1f} grey values on average")
    ax.imshow(picture[40:420, 165:355], cmap="gray")
    ax.axis("off")
plt.show()
