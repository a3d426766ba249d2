// Phases of shifted fringes on CUDA: QUAD neighbouring pixels a thread, all of whose frames are read
// once. taichi/structured_light/phase.py has the equations.

#include "_fringes_cuda.h"

// needs TYPE, QUAD, TURN
void decode_quad(wp::array_t<TYPE> frames, int begin, wp::array_t<float> frequencies,
                 wp::array_t<float> waves, int size, float threshold, bool joins,
                 wp::array_t<float> places, wp::array_t<float> phases,
                 wp::array_t<float> modulations, wp::array_t<wp::uint8> valid) {
    struct alignas(QUAD * sizeof(TYPE)) Pixels {
        TYPE at[QUAD];
    };
    const size_t plane = (size_t)places.shape[0] * places.shape[1];
    const size_t here = ((size_t)blockIdx.x * blockDim.x + threadIdx.x) * QUAD;
    if (here >= plane) return;
    const bool whole = plane % QUAD == 0 && (size_t)frames.data % sizeof(Pixels) == 0;
    const int steps = waves.shape[0];
    const float number = (float)steps, infinity = __int_as_float(0x7f800000);
    const TYPE* from = frames.data + begin * plane + here;
    const auto read = [&]() {
        Pixels pixels;
        if (whole) {
            pixels = *(const Pixels*)from;
        } else {
            for (int i = 0; i < QUAD; ++i) pixels.at[i] = here + i < plane ? from[i] : (TYPE)0;
        }
        from += plane;
        return pixels;
    };
    Pixels next[4];
    bool quarters = sizeof(TYPE) < 4 && steps == 4;
    if (quarters) {
#pragma unroll
        for (int n = 0; n < 4; ++n) next[n] = read();
        // Steps whose sines are 0, 1, 0, -1, as of bytes, give differences of whole numbers.
#pragma unroll
        for (int n = 0; n < 4; ++n) {
            quarters = quarters & (waves.data[2 * n] == (float)(n == 1) - (float)(n == 3)) &
                       (waves.data[2 * n + 1] == (float)(n == 0) - (float)(n == 2));
        }
        if (!quarters) from -= 4 * plane;
    }
    float place[QUAD], angle[QUAD], least[QUAD];
    bool seen[QUAD];
    for (int i = 0; i < QUAD; ++i) place[i] = angle[i] = 0.0f, least[i] = infinity, seen[i] = true;
    for (int j = 0; j < frequencies.shape[0]; ++j) {
        float s[QUAD], c[QUAD];
        if (quarters) {
#pragma unroll
            for (int i = 0; i < QUAD; ++i) {
                s[i] = Fringe::light(next[1].at, i) - Fringe::light(next[3].at, i);
                c[i] = Fringe::light(next[0].at, i) - Fringe::light(next[2].at, i);
            }
            // The frames of the next frequency come while this one is decoded.
            if (j + 1 < frequencies.shape[0]) {
#pragma unroll
                for (int n = 0; n < 4; ++n) next[n] = read();
            }
        } else {
            for (int i = 0; i < QUAD; ++i) s[i] = c[i] = 0.0f;
            for (int n = 0; n < steps; ++n) {
                const Pixels pixels = read();
                const float sine = waves.data[2 * n], cosine = waves.data[2 * n + 1];
                for (int i = 0; i < QUAD; ++i) {
                    const float value = (float)pixels.at[i];
                    s[i] += value * sine;
                    c[i] += value * cosine;
                }
            }
        }
        const float f = frequencies.data[j];
        float turns[QUAD];
#pragma unroll
        for (int i = 0; i < QUAD; ++i) {
            const float r = Fringe::angle(s[i], c[i], quarters);
            angle[i] = r;
            // Roots and quotients keep the order, so those of the least square are the least ones.
            const float square = c[i] * c[i] + s[i] * s[i];
            seen[i] = seen[i] && (quarters || square < infinity);  // false for NaN
            least[i] = square < least[i] ? square : least[i];
            const float p = r * TURN;
            const float k = j ? floorf(f * place[i] - p + 0.5f) : p < 0.0f ? 1.0f : 0.0f;
            turns[i] = p + k;
        }
        Fringe::divide(turns, f, place);
    }
    const float lowest = frequencies.data[0], nowhere = __int_as_float(0x7fc00000);
    bool good[QUAD];
    float part[QUAD], length[QUAD];
#pragma unroll
    for (int i = 0; i < QUAD; ++i) {
        // Noise may have moved a place across the end of the first period.
        const float u = lowest * place[i];
        part[i] = u - floorf(u);
        length[i] = 2.0f * sqrtf(least[i]);
    }
    Fringe::divide(part, lowest, place);
    Fringe::divide(length, number, least);
#pragma unroll
    for (int i = 0; i < QUAD; ++i) {
        place[i] = seen[i] ? place[i] * (float)size - 0.5f : nowhere;
        angle[i] = seen[i] ? angle[i] : nowhere;
        least[i] = seen[i] ? least[i] : nowhere;
        good[i] = least[i] > threshold;
    }
    if (QUAD == 4 && plane % 4 == 0 && (size_t)places.data % 16 == 0 &&
        (size_t)phases.data % 16 == 0 && (size_t)modulations.data % 16 == 0 &&
        (size_t)valid.data % 4 == 0) {
        *(float4*)(places.data + here) = make_float4(place[0], place[1], place[2], place[3]);
        *(float4*)(phases.data + here) = make_float4(angle[0], angle[1], angle[2], angle[3]);
        *(float4*)(modulations.data + here) = make_float4(least[0], least[1], least[2], least[3]);
        uchar4* to = (uchar4*)(valid.data + here);
        const uchar4 before = joins ? *to : make_uchar4(1, 1, 1, 1);
        *to = make_uchar4(before.x && good[0], before.y && good[1], before.z && good[2],
                          before.w && good[3]);
        return;
    }
    for (int i = 0; i < QUAD && here + i < plane; ++i) {
        places.data[here + i] = place[i];
        phases.data[here + i] = angle[i];
        modulations.data[here + i] = least[i];
        valid.data[here + i] = (!joins || valid.data[here + i]) && good[i];
    }
}
