// Phases of shifted fringes on CUDA: QUAD neighbouring pixels a thread, all of whose frames are read
// once. taichi/structured_light/phase.py has the equations.

#include "../_angles.h"

// needs TYPE, QUAD, TURN
void decode_quad(wp::array_t<TYPE> frames, int begin, wp::array_t<float> frequencies,
                 wp::array_t<float> waves, int size, wp::array_t<float> places,
                 wp::array_t<float> phases, wp::array_t<float> modulations) {
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
    float place[QUAD], angle[QUAD], least[QUAD];
    bool seen[QUAD];
    for (int i = 0; i < QUAD; ++i) place[i] = angle[i] = 0.0f, least[i] = infinity, seen[i] = true;
    for (int j = 0; j < frequencies.shape[0]; ++j) {
        float s[QUAD], c[QUAD];
        for (int i = 0; i < QUAD; ++i) s[i] = c[i] = 0.0f;
        for (int n = 0; n < steps; ++n, from += plane) {
            Pixels pixels;
            if (whole) {
                pixels = *(const Pixels*)from;
            } else {
                for (int i = 0; i < QUAD; ++i) pixels.at[i] = here + i < plane ? from[i] : (TYPE)0;
            }
            const float sine = waves.data[2 * n], cosine = waves.data[2 * n + 1];
            for (int i = 0; i < QUAD; ++i) {
                const float value = (float)pixels.at[i];
                s[i] += value * sine;
                c[i] += value * cosine;
            }
        }
        const float f = frequencies.data[j];
        for (int i = 0; i < QUAD; ++i) {
            const float r = Alike::angle(s[i], c[i]);
            angle[i] = r;
            const float length = sqrtf(c[i] * c[i] + s[i] * s[i]);
            seen[i] = seen[i] && length < infinity;  // false for NaN
            const float modulation = 2.0f * length / number;
            least[i] = modulation < least[i] ? modulation : least[i];
            const float p = r * TURN;
            const float k = j ? floorf(f * place[i] - p + 0.5f) : p < 0.0f ? 1.0f : 0.0f;
            place[i] = (p + k) / f;
        }
    }
    const float lowest = frequencies.data[0], nowhere = __int_as_float(0x7fc00000);
    for (int i = 0; i < QUAD && here + i < plane; ++i) {
        // Noise may have moved a place across the end of the first period.
        const float u = lowest * place[i];
        const float inside = (u - floorf(u)) / lowest;
        places.data[here + i] = seen[i] ? inside * (float)size - 0.5f : nowhere;
        phases.data[here + i] = seen[i] ? angle[i] : nowhere;
        modulations.data[here + i] = seen[i] ? least[i] : nowhere;
    }
}
