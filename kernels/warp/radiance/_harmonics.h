#pragma once

// Real spherical harmonics of degree 0 to 3, orthonormal, in the order l^2 + l + m.
struct Harmonics {
    // Write all 16 of a unit vector to h.
    static void write(float x, float y, float z, float* h) {
#ifdef __CUDA_ARCH__
        const float height = 3.0f * z * z - 1.0f;
#else
#pragma clang fp contract(off)
        const float height = __builtin_fmaf(3.0f * z, z, -1.0f);
#endif
        h[0] = 0.28209479177387814f;
        h[1] = -0.4886025119029199f * y;
        h[2] = 0.4886025119029199f * z;
        h[3] = -0.4886025119029199f * x;
        h[4] = 1.0925484305920792f * x * y;
        h[5] = -1.0925484305920792f * y * z;
        h[6] = 0.31539156525252005f * height;
        h[7] = -1.0925484305920792f * x * z;
        h[8] = 0.5462742152960396f * (x * x - y * y);
        h[9] = -0.5900435899266435f * y * (3.0f * x * x - y * y);
        h[10] = 2.890611442640554f * x * y * z;
        h[11] = -0.4570457994644658f * y * (5.0f * z * z - 1.0f);
        h[12] = 0.3731763325901154f * z * (5.0f * z * z - 3.0f);
        h[13] = -0.4570457994644658f * x * (5.0f * z * z - 1.0f);
        h[14] = 1.445305721320277f * z * (x * x - y * y);
        h[15] = -0.5900435899266435f * x * (x * x - 3.0f * y * y);
    }
};
