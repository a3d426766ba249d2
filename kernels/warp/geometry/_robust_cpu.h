// Robust fits on the CPU: groups of hypotheses, refinement and inliers.
// taichi/geometry/robust.py has the method.

#include "_lanes_cpu.h"

// needs KIND, GROUP, PREVIEW, NO_COST, FLAT
// Find the model with the smallest preview in a group of hypotheses, the first of equal ones, and
// score it on all matches.
void best_of_group(int seed, int first, wp::array_t<float> matches, int start, int count,
                   float square, wp::array_t<double> known, int pair, int at,
                   wp::array_t<float> models, wp::array_t<int> costs) {
    const size_t pitch = matches.shape[1];
    const float* x = matches.data + start;
    const int previewed = count < PREVIEW ? count : PREVIEW;
    float best[9] = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
    const double* of_pair = known.data + known.shape[1] * (size_t)pair;
    int least = NO_COST, support;
    for (int n = 0; n < GROUP; ++n) {
        double found[90];
        const int number =
            Robust::solve(KIND, x, pitch, count, seed, first + n, FLAT, of_pair, found);
        for (int m = 0; m < number; ++m) {
            float h[9];
            for (int i = 0; i < 9; ++i) h[i] = (float)found[9 * m + i];
            const int cost = Lanes::cost(KIND, h, of_pair, x, pitch, previewed, square, support);
            if (cost < least) {
                least = cost;
                for (int i = 0; i < 9; ++i) best[i] = h[i];
            }
        }
    }
    if (least < NO_COST) least = Lanes::cost(KIND, best, of_pair, x, pitch, count, square, support);
    for (int i = 0; i < 9; ++i) models.data[9 * (size_t)at + i] = best[i];
    costs.data[at] = least;
}

// needs KIND
// Improve a model; the result stays unless it costs more than before by over a sixteenth.
void improve(wp::array_t<float> matches, int start, int count, float square,
             wp::array_t<double> known, int pair, wp::array_t<float> schedule, int at,
             wp::array_t<double> models, wp::array_t<int> scores) {
    const size_t pitch = matches.shape[1];
    const float* x = matches.data + start;
    const double* of_pair = known.data + known.shape[1] * (size_t)pair;
    double* model = models.data + 9 * (size_t)at;
    int* score = scores.data + 2 * (size_t)at;
    double h[9];
    for (int i = 0; i < 9; ++i) h[i] = model[i];
    for (int round = 0; round < 2; ++round) {
        const int steps = round ? schedule.shape[0] : 0;
        Lanes::improve(KIND, of_pair, x, pitch, count, square, schedule.data, steps, h);
        float f[9];
        for (int i = 0; i < 9; ++i) f[i] = (float)h[i];
        int support;
        const int cost = Lanes::cost(KIND, f, of_pair, x, pitch, count, square, support);
        if (round == 0 || cost <= score[0] + (score[0] >> 4)) {
            score[0] = cost, score[1] = support;
            for (int i = 0; i < 9; ++i) model[i] = h[i];
        }
    }
}

// needs KIND
// Tell which matches are closer to a model than the threshold.
void mark_pair(wp::array_t<float> matches, int start, int count, float square,
               wp::array_t<double> known, int at, wp::array_t<double> models,
               wp::array_t<unsigned char> inliers) {
    const size_t pitch = matches.shape[1];
    const float* match = matches.data + start;
    float model[9], f[12];
    for (int i = 0; i < 9; ++i) model[i] = (float)models.data[9 * (size_t)at + i];
    Robust::prepare(KIND, model, known.data + known.shape[1] * (size_t)at, f);
    for (int i = 0; i < count; ++i)
        inliers.data[start + i] = Robust::residual(KIND, f, match + i, pitch) < square;
}
