"""
A shape, rotated and half hidden
================================

The generalised Hough transform stores a shape as its boundary. Here it finds a silhouette three
times in a noisy picture, rotated and behind a bar.
"""

import matplotlib.pyplot as plt
import numpy as np
from skimage import data, transform

import cvkern

horse = transform.rescale(data.horse().astype(float), 0.35, anti_aliasing=True)
table = cvkern.r_table(255 * horse)

scene = np.full((400, 600), 235.0) + np.random.default_rng(1).normal(0, 6, (400, 600))
for degrees, top, left in ((20, 20, 30), (-40, 170, 250), (160, 10, 380)):
    turned = transform.rotate(horse, degrees, resize=True, cval=1, order=3)
    scene[top : top + len(turned), left : left + len(turned[0])] *= turned.clip(0.1, 1)
scene[120:150] = 90

found = cvkern.generalized_hough(scene, table, rotations=360, num_peaks=3)
plt.figure(figsize=(6, 4))
plt.imshow(scene, cmap="gray", vmin=0, vmax=255)
for position, turn, scale in zip(*found[:3]):
    sine, cosine = np.sin(turn), np.cos(turn)
    outline = position - scale * table.vectors @ [[cosine, -sine], [sine, cosine]]
    plt.plot(outline[:, 1], outline[:, 0], ".", ms=2.5)
plt.axis("off")
plt.show()
