"""
A pair of photographs that moves
================================

`planes_from_stereo` cuts a pair into parallel planes by its disparities. A view from beside the
camera shifts near planes more than far ones; `write_planes` puts them into one page for a browser.
"""

import matplotlib.pyplot as plt
from skimage import data

from cvkern.radiance import cameras, planes_from_stereo, render

left, right, _ = data.stereo_motorcycle()
K = [[994.978, 0, 311.193], [0, 994.978, 254.877], [0, 0, 1]]
model = planes_from_stereo(left, right, K, baseline=193.001, doffs=31.086)
# write_planes(model, "motorcycle.html")

figure, panels = plt.subplots(2, 1, figsize=(6, 8))
for panel, x in zip(panels, (-120, 120), strict=True):
    pose = [[[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0]]]  # the camera, moved by millimetres
    view = cameras(pose, model.cameras.intrinsics[0], left.shape[1], left.shape[0])
    panel.imshow(render(model, view).color)
    panel.set_title(f"{x:+} mm")
    panel.axis("off")
plt.tight_layout()
plt.show()
