// Robust fits on CUDA: groups of hypotheses, refinement and inliers.
// taichi/geometry/robust.py has the method.

#include "_robust.h"

// needs GROUP, PREVIEW, COST_ONE, NO_COST, FLAT
// One warp a group of hypotheses: a lane solves and previews one, then all score the best.
void propose(wp::array_t<float> matches, wp::array_t<int> spans, wp::array_t<float> squares,
             wp::array_t<double> known, wp::array_t<int> pairs, wp::vec_t<3, int> draw,
             wp::array_t<float> models, wp::array_t<int> costs) {
    const int kind = draw[0], seed = draw[1], first = draw[2];
    const int groups = costs.shape[1], lane = threadIdx.x & 31;
    const int item = (int)((blockIdx.x * (size_t)blockDim.x + threadIdx.x) >> 5);
    if (item >= costs.shape[0] * groups) return;  // the whole warp
    const int pair = pairs.data[item / groups];
    const int start = spans.data[2 * pair], count = spans.data[2 * pair + 1];
    const float square = squares.data[pair], scale = COST_ONE / square;
    const size_t pitch = matches.shape[1];
    const float* match = matches.data + start;
    const double* of_pair = known.data + known.shape[1] * (size_t)pair;
    const int previewed = count < PREVIEW ? count : PREVIEW;
    float h[9], f[12];
    int least = NO_COST, which = 0;
    for (int n = lane; n < GROUP; n += 32) {
        double found[90];
        const int hypothesis = first + item % groups * GROUP + n;
        const int number =
            Robust::solve(kind, match, pitch, count, seed, hypothesis, FLAT, of_pair, found);
        for (int m = 0; m < number; ++m) {
            float model[9];
            for (int i = 0; i < 9; ++i) model[i] = (float)found[9 * m + i];
            Robust::prepare(kind, model, of_pair, f);
            int preview = 0;
            for (int i = 0; i < previewed; ++i) {
                const float r = Robust::residual(kind, f, match + i, pitch);
                preview += r < square ? (int)(r * scale + 0.5f) : COST_ONE;
            }
            if (preview < least) {
                least = preview, which = n;
                for (int i = 0; i < 9; ++i) h[i] = model[i];
            }
        }
    }
    if (least == NO_COST)
        for (int i = 0; i < 9; ++i) h[i] = 0.0f;
    long long key = (long long)least << 32 | which;
    for (int half = 16; half > 0; half /= 2) {
        const long long other = __shfl_xor_sync(0xffffffffu, key, half);
        key = other < key ? other : key;
    }
    const bool any = (int)(key >> 32) < NO_COST;
    for (int i = 0; i < 9; ++i) h[i] = __shfl_sync(0xffffffffu, h[i], (int)(key & 31));
    int cost = 0;
    Robust::prepare(kind, h, of_pair, f);
    if (any)
        for (int i = lane; i < count; i += 32) {
            const float r = Robust::residual(kind, f, match + i, pitch);
            cost += r < square ? (int)(r * scale + 0.5f) : COST_ONE;
        }
    for (int half = 16; half > 0; half /= 2) cost += __shfl_xor_sync(0xffffffffu, cost, half);
    if (lane == 0) {
        for (int i = 0; i < 9; ++i) models.data[9 * (size_t)item + i] = h[i];
        costs.data[item] = any ? cost : NO_COST;
    }
}

// needs SUMS, COST_ONE
// One warp a model: a lane sums every 32nd match, and all solve the same equations.
void refine(wp::array_t<float> matches, wp::array_t<int> spans, wp::array_t<float> squares,
            wp::array_t<double> known, wp::array_t<int> pairs, int kind,
            wp::array_t<float> schedule, wp::array_t<double> models, wp::array_t<int> scores) {
    const int lane = threadIdx.x & 31;
    const int item = (int)((blockIdx.x * (size_t)blockDim.x + threadIdx.x) >> 5);
    if (item >= scores.shape[0] * scores.shape[1]) return;  // the whole warp
    const int pair = pairs.data[item / scores.shape[1]];
    const int start = spans.data[2 * pair], count = spans.data[2 * pair + 1];
    const float square = squares.data[pair], scale = COST_ONE / square;
    const size_t pitch = matches.shape[1];
    const float* match = matches.data + start;
    const double* of_pair = known.data + known.shape[1] * (size_t)pair;
    double* model = models.data + 9 * (size_t)item;
    double h[9];
    for (int i = 0; i < 9; ++i) h[i] = model[i];
    int before = 0;
    for (int round = 0; round < 2; ++round) {
        bool fixed = true;
        for (int s = 0; s < schedule.shape[0] && fixed && round; ++s) {
            const double limit = (double)square * (double)schedule.data[s];
            if (!(limit > 0.0)) break;  // no match fixes a step
            double sums[SUMS];
            for (int i = 0; i < SUMS; ++i) sums[i] = 0.0;
            for (int i = lane; i < count; i += 32)
                Robust::add(kind, h, of_pair, match + i, pitch, limit, sums);
            for (int half = 16; half > 0; half /= 2)
                for (int i = 0; i < SUMS; ++i)
                    sums[i] = sums[i] + __shfl_xor_sync(0xffffffffu, sums[i], half);
            fixed = Robust::step(kind, sums, of_pair, h);
        }
        float narrow[9], f[12];
        for (int i = 0; i < 9; ++i) narrow[i] = (float)h[i];
        Robust::prepare(kind, narrow, of_pair, f);
        int cost = 0, support = 0;
        for (int i = lane; i < count; i += 32) {
            const float r = Robust::residual(kind, f, match + i, pitch);
            cost += r < square ? (int)(r * scale + 0.5f) : COST_ONE;
            support += r < square;
        }
        for (int half = 16; half > 0; half /= 2) {
            cost += __shfl_xor_sync(0xffffffffu, cost, half);
            support += __shfl_xor_sync(0xffffffffu, support, half);
        }
        if (round == 0 || cost <= before + (before >> 4)) {
            before = cost;
            if (lane == 0) {
                scores.data[2 * (size_t)item] = cost;
                scores.data[2 * (size_t)item + 1] = support;
                for (int i = 0; i < 9; ++i) model[i] = h[i];
            }
        }
    }
}

// One warp a pair.
void mark(wp::array_t<float> matches, wp::array_t<int> spans, wp::array_t<float> squares,
          wp::array_t<double> known, int kind, wp::array_t<double> models,
          wp::array_t<unsigned char> inliers) {
    const int pair = (int)((blockIdx.x * (size_t)blockDim.x + threadIdx.x) >> 5);
    if (pair >= spans.shape[0]) return;
    const int start = spans.data[2 * pair], count = spans.data[2 * pair + 1];
    const size_t pitch = matches.shape[1];
    const float* match = matches.data + start;
    float model[9], f[12];
    for (int i = 0; i < 9; ++i) model[i] = (float)models.data[9 * (size_t)pair + i];
    Robust::prepare(kind, model, known.data + known.shape[1] * (size_t)pair, f);
    for (int i = threadIdx.x & 31; i < count; i += 32)
        inliers.data[start + i] = Robust::residual(kind, f, match + i, pitch) < squares.data[pair];
}
