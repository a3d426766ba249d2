// Arithmetic of fringes on CUDA, with the bits of the CPU.
// needs QUAD
struct Fringe {
    // Alike::angle of _angles.h for sums, which are never -0, in fewer instructions. If one is NaN,
    // the result is arbitrary.
    static float angle(float y, float x) {
        const float ax = fabsf(x), ay = fabsf(y), high = fmaxf(ax, ay), low = fminf(ax, ay);
        const float a = low / (high > 0.0f ? high : 1.0f);
        const float s = a * a;
        float p = -0.004054466052665892f;
        p = p * s + 0.021862608447395723f;
        p = p * s + -0.055911847344499485f;
        p = p * s + 0.09642164106383755f;
        p = p * s + -0.1390861734379522f;
        p = p * s + 0.19946563377106752f;
        p = p * s + -0.3332986060035421f;
        p = p * s + 0.9999993355361315f;
        float r = p * a;
        r = ay > ax ? 1.5707963267948966f - r : r;
        r = x < 0.0f ? 3.141592653589793f - r : r;
        return y < 0.0f ? -r : r;
    }

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
