"""
A photograph to look around in
==============================

Every pixel with a depth is a point in space. `turntable` draws these points from a camera that
swings around them. `write_animation` makes a film of the frames, and `write_ply` writes the points.
"""

import matplotlib.pyplot as plt
from skimage import data

import cvkern
from cvkern.clouds import turntable

left, right, _ = data.stereo_motorcycle()
found = cvkern.stereo_match(left, right, disparities=(0, 64), channel_axis=-1)
q = cvkern.reprojection_matrix(
    focal=994.978, baseline=193.001, doffs=31.086, cx=311.193, cy=254.877
)
cloud = cvkern.point_cloud(found.disparity, q, left, found.valid)
frames = turntable(*cloud, shape=(400, 560), frames=8)

# sphinx_gallery_thumbnail_number = 2
for frame in frames[[6, 2]]:
    plt.figure(figsize=(6, 4.3))
    plt.imshow(frame)
    plt.axis("off")
plt.show()
