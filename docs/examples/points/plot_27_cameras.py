"""
From photographs to cameras
===========================

`reconstruct` takes photographs of a scene, in any order, and finds where each was taken from, and
points of the scene. Here the library renders the photographs, so that the places are known. Of a
lens that nobody knows it also finds the focal length and the distortion; here the focal length is
told.
"""

import matplotlib.pyplot as plt

import cvkern
from cvkern.radiance import make_scene

scene = make_scene(layout="forward", train=12, test=0, size=240, texture=True)
found = cvkern.reconstruct(scene.images[..., :3], focal_lengths=360)
print(found, "mean error", found.errors.mean().round(2), "pixels")

# sphinx_gallery_thumbnail_number = 2
for title, picture in (
    ("one of 12 photographs", scene.images[4]),
    ("cameras and points", found.picture(480)),
):
    plt.figure(figsize=(5, 5))
    plt.imshow(picture)
    plt.title(title)
    plt.axis("off")
plt.show()
