"""Real spherical harmonics of degree 0 to 3, orthonormal, in the order l^2 + l + m."""

import warp as wp

wp.set_module_options({"enable_backward": False})

vec16 = wp.types.vector(16, wp.float32)

# In C, of a unit vector x, y, z.
HARMONICS = (
    "0.28209479177387814f",
    "-0.4886025119029199f * y",
    "0.4886025119029199f * z",
    "-0.4886025119029199f * x",
    "1.0925484305920792f * x * y",
    "-1.0925484305920792f * y * z",
    "0.31539156525252005f * (3.0f * z * z - 1.0f)",
    "-1.0925484305920792f * x * z",
    "0.5462742152960396f * (x * x - y * y)",
    "-0.5900435899266435f * y * (3.0f * x * x - y * y)",
    "2.890611442640554f * x * y * z",
    "-0.4570457994644658f * y * (5.0f * z * z - 1.0f)",
    "0.3731763325901154f * z * (5.0f * z * z - 3.0f)",
    "-0.4570457994644658f * x * (5.0f * z * z - 1.0f)",
    "1.445305721320277f * z * (x * x - y * y)",
    "-0.5900435899266435f * x * (x * x - 3.0f * y * y)",
)


@wp.func_native(
    "wp::vec_t<16, float> h;\n"
    + "".join(f"h[{k}] = {value};\n" for k, value in enumerate(HARMONICS))
    + "return h;"
)
def harmonics(x: float, y: float, z: float) -> vec16:
    """Return all of them for a unit vector."""
    ...
