#pragma once
// Arithmetic that the CPU and CUDA do alike: sums, products, quotients and roots, each rounded.
struct Alike {
    // Arc tangent of 0 <= a <= 1: the polynomial of _angles.py.
    static inline float turn(float a) {
#pragma clang fp contract(off)
        const float s = a * a;
        float p = -0.004054466052665892f;
        p = p * s + 0.021862608447395723f;
        p = p * s + -0.055911847344499485f;
        p = p * s + 0.09642164106383755f;
        p = p * s + -0.1390861734379522f;
        p = p * s + 0.19946563377106752f;
        p = p * s + -0.3332986060035421f;
        p = p * s + 0.9999993355361315f;
        return p * a;
    }

    // Angle of (x, y) in (-pi, pi], within 2e-7.
    static inline float angle(float y, float x) {
#pragma clang fp contract(off)
        const float ax = x < 0.0f ? -x : x, ay = y < 0.0f ? -y : y;
        return angle(y, x, ay > ax, ax < ay ? ax : ay, ax < ay ? ay : ax);
    }

    // The same, from whether |y| > |x|, and the smaller and the larger of both.
    static inline float angle(float y, float x, bool steep, float low, float high) {
#pragma clang fp contract(off)
        const float a = high > 0.0f ? low / (high > 0.0f ? high : 1.0f) : 0.0f;
        float r = turn(a);
        r = steep ? 1.5707963267948966f - r : r;
        r = x < 0.0f ? 3.141592653589793f - r : r;
        return y < 0.0f ? -r : r;
    }

    // exp(-x) for 0 <= x <= 8: a series for x / 16, squared four times.
    static inline float decay(float x) {
#pragma clang fp contract(off)
        const float y = x * 0.0625f;
        float p = 1.0f;
        p = 1.0f - y * (1.0f / 7.0f) * p;
        p = 1.0f - y * (1.0f / 6.0f) * p;
        p = 1.0f - y * (1.0f / 5.0f) * p;
        p = 1.0f - y * (1.0f / 4.0f) * p;
        p = 1.0f - y * (1.0f / 3.0f) * p;
        p = 1.0f - y * (1.0f / 2.0f) * p;
        p = 1.0f - y * p;
        p = p * p;
        p = p * p;
        p = p * p;
        return p * p;
    }
};
