#pragma once

// A ray's samples, 32 at a time, one per lane of a warp. A sum or product over all preceding
// samples combines the value of the groups of 32 before, which is carried along, with a scan over
// the preceding lanes.
struct CompositingWalk {
    const float *sigma, *rgb, *distances;
    int end;  // the row after the last
    float stop;
    // T, and sums of w and w t: before the current 32 samples, and, after take(), including them.
    float left, sum_w, sum_wt;
    // The sample of this lane: zeros unless it is lit, even if the sample is NaN.
    int row;
    bool own, lit;  // whether it belongs to the ray; whether light reaches it
    unsigned dark;  // the lanes whose samples are not lit
    float t, d, red, green, blue;
    float before, w;        // T, and its weight
    float upto_w, upto_wt;  // sums of w and w t up to and including this sample
    float nearer;           // sum of w_j |t_i - t_j| over j < i

    static int lane() { return threadIdx.x & 31; }

    static float sum_up_to(float x) {  // sum over the lanes up to and including this one
        for (int s = 1; s < 32; s *= 2) {
            const float before = __shfl_up_sync(0xffffffffu, x, s);
            x += lane() >= s ? before : 0.0f;
        }
        return x;
    }

    static float sum(float x) {
        for (int s = 16; s; s /= 2) x += __shfl_xor_sync(0xffffffffu, x, s);
        return x;
    }

    static float lane_before(float x, float carried) {
        const float before = __shfl_up_sync(0xffffffffu, x, 1);
        return lane() ? before : carried;
    }

    void begin() {
        left = 1.0f;
        sum_w = sum_wt = 0.0f;
    }

    // Read the samples that begin at row `first`.
    void take(int first) {
        const unsigned all = 0xffffffffu;
        row = first + lane();
        own = row < end;
        const float* at = distances + 2 * (size_t)row;
        const float* from = rgb + 3 * (size_t)row;
        t = own ? at[0] : 0.0f;
        d = own ? at[1] : 0.0f;
        red = own ? from[0] : 0.0f;
        green = own ? from[1] : 0.0f;
        blue = own ? from[2] : 0.0f;
        const float through = own ? expf(-sigma[row] * d) : 1.0f;
        float passed = through;
        for (int s = 1; s < 32; s *= 2) {
            const float others = __shfl_up_sync(all, passed, s);
            passed *= lane() >= s ? others : 1.0f;
        }
        before = left * lane_before(passed, 1.0f);
        // Rounding may make a scanned product grow, so no sample after the first dark one is lit.
        dark = __ballot_sync(all, !own || !(before > stop));
        lit = !(dark << (31 - lane()));
        if (!lit) t = d = red = green = blue = 0.0f;
        w = lit ? before * (1.0f - through) : 0.0f;
        upto_w = sum_w + sum_up_to(w);
        upto_wt = sum_wt + sum_up_to(w * t);
        const float before_w = lane_before(upto_w, sum_w);
        const float before_wt = lane_before(upto_wt, sum_wt);
        left *= __shfl_sync(all, passed, 31);
        sum_w = __shfl_sync(all, upto_w, 31);
        sum_wt = __shfl_sync(all, upto_wt, 31);
        nearer = t * before_w - before_wt;
    }
};
