"""Numbers of shading that the API and both kernel sets share."""

DIRECTIONAL, HARMONIC = 3, 9  # coefficients of a light: a vector, or harmonics up to degree 2
SHADOW_BIAS = 1e-3  # pixels by which a surface must stand above a ray to stop it
NOTHING = 2**63 - 1  # key of a pixel that no triangle covers
DEPTH_STEPS = 2.0**12  # steps of depth per pixel, in the upper half of a key
