#include "../_angles.h"

// needs DISC, BLUR, PAIRS, TURNS, TURNS_PER_RADIAN
// Direction of the point of a block by the moments of a disc, and its bits: pairs of pixels
// compared, of the image smoothed down the rows and then along the columns.
void describe(wp::array_t<wp::int64> images, wp::array_t<float> taps, wp::array_t<int> cells,
              wp::array_t<int> pattern, int upright, wp::array_t<float> angles,
              wp::array_t<wp::uint8> descriptors) {
    enum { SIDE = 2 * DISC + 1, READ = SIDE + 2 * BLUR, TAPS = 2 * BLUR + 1 };
    __shared__ unsigned char pixels[READ][READ + 1];
    __shared__ float lines[SIDE][READ + 1], smooth[SIDE][SIDE + 1];
    __shared__ float tap[TAPS];
    __shared__ int moments[2];
    const int k = blockIdx.x, thread = threadIdx.x, threads = blockDim.x;
    const int* cell = cells.data + 4 * (size_t)k;
    const wp::int64* image = images.data + 4 * (size_t)cell[0];
    const size_t width = (size_t)image[3];
    const unsigned char* const from =
        (const unsigned char*)image[0] + (cell[2] - DISC - BLUR) * width + cell[3] - DISC - BLUR;
    for (int n = thread; n < READ * READ; n += threads)
        pixels[n / READ][n % READ] = from[n / READ * width + n % READ];
    if (thread < TAPS) tap[thread] = taps.data[thread];
    if (thread < 2) moments[thread] = 0;
    __syncthreads();
    int down = 0, along = 0;
    for (int n = thread; n < SIDE * SIDE && !upright; n += threads) {
        const int i = n / SIDE - DISC, j = n % SIDE - DISC;
        if (i * i + j * j > DISC * (DISC + 1)) continue;
        const int v = pixels[i + DISC + BLUR][j + DISC + BLUR];
        down += i * v;
        along += j * v;
    }
    for (int apart = 16; apart; apart /= 2) {
        down += __shfl_xor_sync(~0u, down, apart);
        along += __shfl_xor_sync(~0u, along, apart);
    }
    if (thread % 32 == 0) {
        atomicAdd(&moments[0], down);
        atomicAdd(&moments[1], along);
    }
    for (int n = thread; n < SIDE * READ; n += threads) {
        const int i = n / READ, j = n % READ;
        float sum = 0.0f;
        for (int t = 0; t < TAPS; ++t) sum += tap[t] * (float)pixels[i + t][j];
        lines[i][j] = sum;
    }
    __syncthreads();
    for (int n = thread; n < SIDE * SIDE; n += threads) {
        const int i = n / SIDE, j = n % SIDE;
        float sum = 0.0f;
        for (int t = 0; t < TAPS; ++t) sum += tap[t] * lines[i][j + t];
        smooth[i][j] = sum;
    }
    float angle = 0.0f;
    int turn = 0;
    if (!upright) {
        angle = Alike::angle((float)moments[0], (float)moments[1]);
        turn = (int)floorf(angle * TURNS_PER_RADIAN + 0.5f) & (TURNS - 1);
    }
    if (thread == 0) angles.data[k] = angle;
    __syncthreads();
    const int* const pairs = pattern.data + (size_t)turn * PAIRS * 4;
    for (int p = thread; p < PAIRS; p += threads) {
        const int* const pair = pairs + 4 * p;
        const float one = smooth[DISC + pair[0]][DISC + pair[1]];
        const float other = smooth[DISC + pair[2]][DISC + pair[3]];
        const unsigned word = __ballot_sync(~0u, one < other);
        if (thread % 8 == 0)
            descriptors.data[(size_t)k * (PAIRS / 8) + p / 8] =
                (wp::uint8)(word >> thread % 32 & 255);
    }
}
