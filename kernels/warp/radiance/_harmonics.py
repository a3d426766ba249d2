"""Real spherical harmonics of degree 0 to 3 of a unit vector, in Warp.

They are orthonormal, in the order l^2 + l + m [Sloan, "Stupid spherical harmonics tricks", 2008].
Native code has the same polynomials in _harmonics.h.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

vec16 = wp.types.vector(16, wp.float32)


@wp.func
def harmonics(x: float, y: float, z: float) -> vec16:
    """Return all 16 for a unit vector."""
    return vec16(
        0.28209479177387814,
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (3.0 * z * z - 1.0),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (x * x - y * y),
        -0.5900435899266435 * y * (3.0 * x * x - y * y),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (5.0 * z * z - 1.0),
        0.3731763325901154 * z * (5.0 * z * z - 3.0),
        -0.4570457994644658 * x * (5.0 * z * z - 1.0),
        1.445305721320277 * z * (x * x - y * y),
        -0.5900435899266435 * x * (x * x - 3.0 * y * y),
    )
