"""
Coins, with sub-pixel accuracy
==============================

Every edge point votes along its gradient for centres, in one accumulator for all radii. The colour
shows the visible share of each rim.
"""

import matplotlib.pyplot as plt
from matplotlib.patches import Circle
from skimage import data

import cvkern

photo = data.coins()
found = cvkern.detect_circles(photo, (15, 35))

print(f"{len(found.radii)} coins")
plt.figure(figsize=(6, 4.7))
plt.imshow(photo, cmap="gray")
for (row, column), radius, support in zip(*found):
    color = plt.get_cmap("plasma")(support)
    plt.gca().add_patch(Circle((column, row), radius, fill=False, color=color, lw=2.5))
plt.axis("off")

plt.show()
