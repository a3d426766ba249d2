"""
Segments of a photograph
========================

`detect_segments` finds the straight segments of a photograph in one call. Sub-pixel edges vote
across their gradients; at each peak of the votes, a segment is fitted to edges that follow one
another.
"""

import matplotlib.pyplot as plt
from matplotlib.collections import LineCollection
from skimage import data

import cvkern
from cvkern.images import luma

photo = data.rocket()
segments = cvkern.detect_segments(
    luma(photo), low_threshold=0.85, high_threshold=0.95, use_quantiles=True, min_length=15
)
print(f"{len(segments)} segments of 15 pixels or more")
ends = segments.reshape(-1, 2, 2)[..., ::-1]  # (row, column) to (x, y)

plt.figure(figsize=(6, 4))
plt.imshow(photo)
plt.gca().add_collection(LineCollection(ends, colors="#ffd23c", linewidths=1.8))
plt.axis("off")

plt.show()
