#include "../_angles.h"

// Arithmetic of fringes on CUDA, with the bits of the CPU.
// needs QUAD
struct Fringe {
    // Alike::angle of _angles.h in fewer instructions, with its polynomial. -0 counts as 0, as there.
    // If one number is NaN, the result is arbitrary. With `whole`, both are whole, and less than 2^16.
    static float angle(float y, float x, bool whole) {
        const float ax = fabsf(x), ay = fabsf(y), high = fmaxf(ax, ay), low = fminf(ax, ay);
        const float a =
            whole ? quotient(low, fmaxf(high, 1.0f)) : low / (high > 0.0f ? high : 1.0f);
        float r = Alike::turn(a);
        r = ay > ax ? 1.5707963267948966f - r : r;
        r = x < 0.0f ? 3.141592653589793f - r : r;
        return y < 0.0f ? -r : r;
    }

    // low / high as IEEE rounds it, for whole numbers 0 <= low <= high < 2^16, high > 0. The product
    // is within 2^-22 of the quotient and leaves a remainder that is exact. With that, the quotient
    // is within 2^-44 before it is rounded; and it is further than 2^-42 from where that changes.
    static float quotient(float low, float high) {
        float q;
        asm("{\n"
            ".reg .f32 r, p, e;\n"
            "rcp.approx.f32 r, %2;\n"
            "mul.rn.f32 p, %1, r;\n"
            "neg.f32 e, %2;\n"
            "fma.rn.f32 e, e, p, %1;\n"
            "fma.rn.f32 %0, e, r, p;\n"
            "}"
            : "=f"(q)
            : "f"(low), "f"(high));
        return q;
    }

    // The pixel of a frame, for bytes above 2^23: differences of two are exact.
    static float light(const wp::uint8* pixels, int i) {
        if (QUAD != 4) return (float)pixels[i];
        const unsigned four = *(const unsigned*)pixels;  // aligned
        return __uint_as_float(__byte_perm(four, 0x4b000000u, 0x7540 + i));
    }
    static float light(const wp::uint16* pixels, int i) { return (float)pixels[i]; }
    static float light(const float* pixels, int i) { return pixels[i]; }

    // Quotients by one number. The reciprocal of a power of two is exact.
    static void divide(const float* from, float by, float* to) {
        if ((__float_as_int(by) & 0x7fffff) == 0) {
            const float inverse = 1.0f / by;
#pragma unroll
            for (int i = 0; i < QUAD; ++i) to[i] = from[i] * inverse;
        } else {
#pragma unroll
            for (int i = 0; i < QUAD; ++i) to[i] = from[i] / by;
        }
    }
};
