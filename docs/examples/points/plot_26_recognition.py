"""
Coins by the words of their patches
===================================

`ShapeModel` learns from the coins in the left half of a photograph, with their masks, and from
pictures without coins. In the right half it finds coins of other sizes, and their pixels.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage import data

import cvkern

photo, split = data.coins(), 192
disks = cvkern.detect_circles(photo, (15, 35))
row, column = np.indices(photo.shape)
boxes, mask = [], np.zeros(photo.shape, bool)
for (r, c), radius in zip(disks.centers, disks.radii, strict=True):
    if c + radius + 3 < split:
        boxes.append([r - radius - 2, c - radius - 2, r + radius + 3, c + radius + 3])
        mask |= np.hypot(row - r, column - c) <= radius

model = cvkern.ShapeModel(200, patch=12, size=40, layers=1)
others = [data.camera()[::2, ::2], data.page()[:, :200], data.brick()[:200, :250]]
model.fit([photo[:, :split]], [boxes], [mask[:, :split]], others)
scales = (0.71, 0.84, 1.0, 1.19, 1.41, 1.68)
found = model.segment(photo[:, split:], scales=scales, threshold=6.0)
print("scores", found.objects.scores.round(1))

figure, axes = plt.subplots(1, 3, figsize=(7, 3.9))
axes[0].imshow(photo[:, :split], cmap="gray")
axes[1].imshow(model.votes(photo[:, split:], scales=scales)[3], cmap="magma")
axes[2].imshow(photo[:, split:], cmap="gray")
axes[2].imshow(np.where(found.masks.any(axis=0), 1.0, np.nan), cmap="autumn", alpha=0.4)
for box in found.objects.boxes:
    axes[2].plot(box[[1, 3, 3, 1, 1]], box[[0, 0, 2, 2, 0]], "y", scalex=False, scaley=False)
for axis, name in zip(axes, ("learnt from", "votes", "found"), strict=True):
    axis.set(title=name, xticks=[], yticks=[])
plt.show()
