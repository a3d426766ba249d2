"""
Two photographs that are not rectified
======================================

`reconstruct_pair` takes two photographs of a scene from different places. It matches keypoints,
finds how the camera moved, turns both pictures so that their rows meet, and matches every pixel.
Here the second camera is turned as well. A keypoint gives one exact point; all pixels give a
surface.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage import data

import cvkern

left, right, _ = data.stereo_motorcycle()
K0 = np.array([[995.0, 0, 311], [0, 995, 255], [0, 0, 1]])
K1 = np.array([[995.0, 0, 342], [0, 995, 255], [0, 0, 1]])
turned = cvkern.rotate(right, 7, mode="reflect", channel_axis=-1, dtype=np.uint8)
pair = cvkern.reconstruct_pair(left, turned, [K0, K1], baseline=0.193)

# sphinx_gallery_thumbnail_number = 2
for title, picture in (("the second photograph", turned), ("depth, metres", pair.depth)):
    plt.figure(figsize=(6, 4))
    plt.imshow(picture, cmap="magma_r", vmax=5)
    plt.scatter(*pair.places.T[::-1], s=3, c="w") if picture is pair.depth else None
    plt.title(title)
    plt.axis("off")
plt.show()
