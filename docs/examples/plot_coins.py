"""
Coins, between the pixels
=========================

Every edge point votes along its gradient for centres.
"""

import matplotlib.pyplot as plt
from matplotlib.patches import Circle
from skimage import data

import cvkern

photo = data.coins()
found = cvkern.detect_circles(photo, (15, 35))

plt.figure(figsize=(6.4, 5.05))
plt.imshow(photo, cmap="gray")
for (row, column), radius in zip(found.centers, found.radii):
    plt.gca().add_patch(Circle((column, row), radius, fill=False, color="#ff6229", lw=2))
plt.axis("off")
plt.show()
