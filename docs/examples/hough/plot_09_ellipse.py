"""
The rim of a cup
================

Two points whose gradients lie along the line between them are taken as the ends of an ellipse's
major axis; all other points vote for the minor axis.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Ellipse
from skimage import data

import cvkern
from cvkern.images import luma

photo = data.coffee()
gray = luma(photo).astype(np.uint8)
found = cvkern.detect_ellipses(gray, axis_range=(85, 200))

plt.figure(figsize=(6, 4))
plt.imshow(photo)
for (row, column), (major, minor), turn in zip(found.centers, found.axes, found.orientation):
    plt.gca().add_patch(
        Ellipse(
            (column, row),
            2 * major,
            2 * minor,
            angle=np.degrees(turn),
            fill=False,
            color="#40dcff",
            lw=3,
        )
    )
plt.axis("off")
plt.show()
