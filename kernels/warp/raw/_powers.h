#pragma once
// Logarithms and powers of 2, of the same bits on every device: sums and products in this order.
struct Powers {
    union Bits {
        float value;
        int bits;
    };

    // log2 x, x > 0 and normal: 2 / ln 2 (s + s^3 / 3 + ...) with s = f / (2 + f), x = 2^n (1 + f).
    static CUDA_CALLABLE float log2(float x) {
#pragma clang fp contract(off)
        Bits u;
        u.value = x;
        const int n = (u.bits - 0x3f3504f3) >> 23;
        u.bits -= n << 23;
        const float f = u.value - 1.0f, s = f / (2.0f + f), z = s * s;
        const float high = 0.412198583f + z * 0.320598898f;
        const float low = 0.961796694f + z * (0.577078016f + z * high);
        return (float)n + s * (2.885390082f + z * low);
    }

    // 2^x, x limited to where the result is normal: Taylor's series about the nearest integer.
    static CUDA_CALLABLE float exp2(float x) {
#pragma clang fp contract(off)
        x = x < -126.0f ? -126.0f : x > 127.0f ? 127.0f : x;
        const int n = (int)(x + (x < 0.0f ? -0.5f : 0.5f));
        const float f = x - (float)n;
        const float high = 0.00961812911f + f * (0.00133335581f + f * 0.000154035304f);
        const float low = 0.240226507f + f * (0.0555041087f + f * high);
        Bits u;
        u.bits = (n + 127) << 23;
        return u.value * (1.0f + f * (0.693147181f + f * low));
    }
};
