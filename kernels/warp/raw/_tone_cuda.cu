// Luminance with the ends and the sum of its logarithms, and colours scaled by powers of 2, of four
// pixels or values a thread. Sums are those of _tone.h, in the same order.
#include "_powers.h"
#include "_sums_cuda.h"

// needs RED, GREEN, BLUE, UNSEEN, STEPS, SLOTS
void survey_four(wp::array_t<float> radiance, wp::array_t<float> logs,
                 wp::array_t<wp::int64> sums) {
    const int channels = radiance.shape[2], count = logs.shape[0] * logs.shape[1];
    const bool aligned = (((size_t)radiance.data | (size_t)logs.data) & 15) == 0;
    const auto seen = [](float v) { return v > 0.0f && v < 3.4e38f ? v : 0.0f; };
    Sums own;
    for (int i = 4 * (blockIdx.x * blockDim.x + threadIdx.x); i < count;
         i += 4 * gridDim.x * blockDim.x) {
        const int some = count - i < 4 ? count - i : 4;
        const float* from = radiance.data + (size_t)i * channels;
        float v[12], found[4];
        if (aligned && some == 4) {
            for (int k = 0; k < 3; ++k) {
                if (k >= channels) break;
                const float4 four = ((const float4*)from)[k];
                v[4 * k] = four.x;
                v[4 * k + 1] = four.y;
                v[4 * k + 2] = four.z;
                v[4 * k + 3] = four.w;
            }
        } else {
            for (int k = 0; k < 12; ++k) v[k] = k < some * channels ? from[k] : 0.0f;
        }
        for (int k = 0; k < 4; ++k) {
            const float light = channels == 1
                                    ? seen(v[k])
                                    : (RED * seen(v[3 * k]) + GREEN * seen(v[3 * k + 1])) +
                                          BLUE * seen(v[3 * k + 2]);
            found[k] = light > 1.2e-38f ? Powers::log2(light) : UNSEEN;
            if (k < some) own.add(found[k]);
        }
        if (aligned && some == 4)
            *(float4*)(logs.data + i) = make_float4(found[0], found[1], found[2], found[3]);
        else
            for (int k = 0; k < 4; ++k)
                if (k < some) logs.data[i + k] = found[k];
    }
    own.share(sums.data);
}

// needs RED, GREEN, BLUE, UNSEEN, STEPS, SLOTS
void show_four(wp::array_t<float> radiance, wp::array_t<float> one, float own,
               wp::array_t<float> two, float other, float offset, wp::array_t<float> out) {
    const int channels = radiance.shape[2], count = one.shape[0] * one.shape[1];
    const bool aligned =
        (((size_t)radiance.data | (size_t)one.data | (size_t)two.data | (size_t)out.data) & 15) ==
        0;
    const auto shown = [](float v, float ratio) {
        const float value = (v > 0.0f && v < 3.4e38f ? v : 0.0f) * ratio;
        return value < 1.0f ? value : 1.0f;
    };
    const auto ratio = [&](int pixel) {
        return Powers::exp2((own * one.data[pixel] + other * two.data[pixel]) + offset);
    };
    const size_t values = (size_t)count * channels;
    for (size_t i = 4 * ((size_t)blockIdx.x * blockDim.x + threadIdx.x); i < values;
         i += 4 * (size_t)gridDim.x * blockDim.x) {
        // Four values are those of two pixels at most if there are three channels.
        const int first = (int)(i / channels), from = (int)(i - (size_t)first * channels);
        if (aligned && i + 4 <= values && channels == 3) {
            const float a = ratio(first), b = ratio(first + 1);
            const float4 v = *(const float4*)(radiance.data + i);
            *(float4*)(out.data + i) = make_float4(shown(v.x, a), shown(v.y, from < 2 ? a : b),
                                                   shown(v.z, from < 1 ? a : b), shown(v.w, b));
            continue;
        }
        for (int k = 0; k < 4; ++k)
            if (i + k < values)
                out.data[i + k] = shown(radiance.data[i + k], ratio((int)((i + k) / channels)));
    }
}
