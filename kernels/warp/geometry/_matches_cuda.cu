#include "_match_cuda.h"

// needs THREADS, NEAR
// Sort the finite matches of a pair by their keys, equal ones once: one block, by bitonic merging
// in shared memory, or in global memory if there are more than NEAR. List them, their places and
// their box.
void sort_pair(wp::array_t<double> points0, wp::array_t<double> points1, wp::array_t<int> spans,
               wp::array_t<wp::uint64> keys, wp::array_t<int> order, wp::array_t<int> places,
               wp::array_t<int> counts, wp::array_t<double> boxes) {
    __shared__ Match::Key near[NEAR];
    __shared__ int parts[THREADS];
    __shared__ double ends[2][THREADS];
    const Match::Key none = ~0ull;  // behind all keys
    const int pair = blockIdx.x, thread = threadIdx.x;
    const int *const span = spans.data + 3 * (size_t)pair, first = span[0], count = span[1];
    int size = 1;
    while (size < count) size *= 2;
    Match::Key* const key = size <= NEAR ? near : (Match::Key*)keys.data + 2 * (size_t)first;
    for (int i = thread; i < size; i += THREADS) {
        key[i] = none;
        if (i >= count) continue;
        const Match match(points0, points1, first + i);
        if (match.finite())
            key[i] = match.key(i);
        else
            places.data[first + i] = -1;
    }
    __syncthreads();
    for (int width = 2; width <= size; width *= 2)
        for (int apart = width / 2; apart > 0; apart /= 2) {
            for (int n = thread; n < size / 2; n += THREADS) {
                const int i = n / apart * 2 * apart + n % apart, j = i + apart;
                const Match::Key a = key[i], b = key[j];
                if ((a > b) == ((i & width) == 0)) key[i] = b, key[j] = a;
            }
            __syncthreads();
        }
    const int rows = points0.shape[1] + 2;
    const double far = 1.0 / 0.0;
    double low[Match::MOST], high[Match::MOST];
    for (int r = 0; r < Match::MOST; ++r) low[r] = far, high[r] = -far;
    int number = 0;
    for (int base = 0; base < size; base += THREADS) {
        const int k = base + thread;
        const bool there = k < size && key[k] != none;
        bool fresh = there;
        if (there && k > 0 && Match::alike(key[k], key[k - 1]))
            fresh = Match(points0, points1, first + Match::index(key[k])) !=
                    Match(points0, points1, first + Match::index(key[k - 1]));
        parts[thread] = fresh;
        __syncthreads();
        for (int apart = 1; apart < THREADS; apart *= 2) {
            const int before = thread >= apart ? parts[thread - apart] : 0;
            __syncthreads();
            parts[thread] += before;
            __syncthreads();
        }
        const int at = number + parts[thread] - 1;
        if (there) places.data[first + Match::index(key[k])] = span[2] + at;
        if (fresh) {
            order.data[first + at] = Match::index(key[k]);
            const Match match(points0, points1, first + Match::index(key[k]));
            for (int r = 0; r < Match::MOST; ++r) {
                low[r] = match.value[r] < low[r] ? match.value[r] : low[r];
                high[r] = match.value[r] > high[r] ? match.value[r] : high[r];
            }
        }
        number += parts[THREADS - 1];
        __syncthreads();
    }
    for (int r = 0; r < rows; ++r) {
        ends[0][thread] = low[r], ends[1][thread] = high[r];
        __syncthreads();
        for (int half = THREADS / 2; half > 0; half /= 2) {
            if (thread < half) {
                const double a = ends[0][thread + half], b = ends[1][thread + half];
                if (a < ends[0][thread]) ends[0][thread] = a;
                if (b > ends[1][thread]) ends[1][thread] = b;
            }
            __syncthreads();
        }
        if (thread < 2)
            boxes.data[2 * (size_t)rows * pair + thread * rows + r] =
                number ? ends[thread][0] : 0.0;
        __syncthreads();
    }
    if (thread == 0) counts.data[pair] = number;
}

// needs THREADS
// Scale the matches of a pair, in their order; there are zeros up to the next pair. One block.
void scale_pair(wp::array_t<double> points0, wp::array_t<double> points1, wp::array_t<int> spans,
                wp::array_t<int> order, wp::array_t<int> counts, wp::array_t<double> scales,
                int lanes, wp::array_t<float> matches) {
    const int pair = blockIdx.x;
    const int* const span = spans.data + 3 * (size_t)pair;
    const int rows = matches.shape[0], room = (span[1] + lanes - 1) / lanes * lanes;
    const double *const scale = scales.data + 2 * (size_t)rows * pair, *const shift = scale + rows;
    for (int k = threadIdx.x; k < room; k += THREADS) {
        float* const to = matches.data + span[2] + k;
        const size_t pitch = matches.shape[1];
        if (k < counts.data[pair]) {
            const Match match(points0, points1, span[0] + order.data[span[0] + k]);
            for (int r = 0; r < rows; ++r)
                to[r * pitch] = (float)(match.value[r] * scale[r] - shift[r]);
        } else {
            for (int r = 0; r < rows; ++r) to[r * pitch] = 0.0f;
        }
    }
}
