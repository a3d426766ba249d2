#pragma once

// Sums of fractions as integers of UNIT, which do not depend on the order of the summands.
struct FixedPoint {
    // Add a number, clipped to LIMIT; a NaN makes the sum NaN permanently.
    static void add(wp::int64* to, float value) {
        if (value == value)
            atomicAdd((unsigned long long*)to,
                      (unsigned long long)__float2ll_rn(fminf(fmaxf(value, -LIMIT), LIMIT) *
                                                        (1.0f / UNIT)));
        else
            atomicExch((unsigned long long*)to, 1ull << 63);
    }

    // Convert a sum to a number, or NaN.
    static float fraction(long long sum) {
        const bool broken = sum >= 1ll << 62 || sum <= -(1ll << 62);
        return broken ? __int_as_float(0x7fffffff) : __ll2float_rn(sum) * UNIT;
    }
};
