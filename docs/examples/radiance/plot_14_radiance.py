"""
A scene learnt in seconds
=========================

`make_scene` renders photographs of a few solids. `fit` learns a field of densities and colours from
them. `render` shows this field from places where no camera stood.
"""

import matplotlib.pyplot as plt

from cvkern.radiance import VoxelField, fit, make_scene, orbit_cameras, render

scene = make_scene(train=30, test=2)
field = VoxelField(resolutions=(32, 64), shares=(0.3,))
model = fit(scene, field, steps=600, progress=False)
picture = render(model, orbit_cameras(scene.cameras, 12, factor=3.0), view=4)

plt.figure(figsize=(6, 4))
plt.imshow(picture.color[40:250])
plt.axis("off")

plt.figure(figsize=(6, 4))
plt.imshow(picture.depth[40:250], cmap="inferno_r")
plt.axis("off")
plt.colorbar(label="distance", shrink=0.7)
plt.show()
