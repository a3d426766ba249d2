#include "../_angles.h"

// needs DISC, BLUR, TAPS, REACH, PITCH, PAIRS, TURNS, TURNS_PER_RADIAN
// Direction of the point of a block by the moments of a disc, and its bits: pairs of pixels
// compared, of the image smoothed down the rows and then along the columns, in integers.
void describe(wp::array_t<wp::int64> images, wp::array_t<int> cells, wp::array_t<wp::int16> pattern,
              int upright, wp::array_t<float> angles, wp::array_t<wp::uint8> descriptors) {
    enum { SIDE = 2 * REACH + 1, READ = SIDE + 2 * BLUR, COUNT = 2 * BLUR + 1 };
    enum { EDGE = REACH + BLUR, DISC_SIDE = 2 * DISC + 1 };
    __shared__ unsigned char pixels[READ][READ + 1], smooth[SIDE * PITCH];
    __shared__ unsigned short lines[SIDE][READ + 1];
    __shared__ int moments[2];
    const int tap[COUNT] = {TAPS};
    const int k = blockIdx.x, thread = threadIdx.x, threads = blockDim.x;
    const int* cell = cells.data + 4 * (size_t)k;
    const wp::int64* image = images.data + 4 * (size_t)cell[0];
    const size_t width = (size_t)image[3];
    const unsigned char* const from =
        (const unsigned char*)image[0] + (cell[2] - EDGE) * width + cell[3] - EDGE;
    for (int n = thread; n < READ * READ; n += threads)
        pixels[n / READ][n % READ] = from[n / READ * width + n % READ];
    if (thread < 2) moments[thread] = 0;
    __syncthreads();
    int down = 0, along = 0;
    for (int n = thread; n < DISC_SIDE * DISC_SIDE && !upright; n += threads) {
        const int i = n / DISC_SIDE - DISC, j = n % DISC_SIDE - DISC;
        if (i * i + j * j > DISC * (DISC + 1)) continue;
        const int v = pixels[i + EDGE][j + EDGE];
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
        int sum = 0;
#pragma unroll
        for (int t = 0; t < COUNT; ++t) sum += tap[t] * pixels[i + t][j];
        lines[i][j] = (unsigned short)sum;
    }
    __syncthreads();
    for (int n = thread; n < SIDE * SIDE; n += threads) {
        const int i = n / SIDE, j = n % SIDE;
        int sum = 1 << 15;
#pragma unroll
        for (int t = 0; t < COUNT; ++t) sum += tap[t] * lines[i][j + t];
        smooth[i * PITCH + j] = (unsigned char)(sum >> 16);
    }
    float angle = 0.0f;
    int turn = 0;
    if (!upright) {
        angle = Alike::angle((float)moments[0], (float)moments[1]);
        turn = (int)floorf(angle * TURNS_PER_RADIAN + 0.5f) & (TURNS - 1);
    }
    if (thread == 0) angles.data[k] = angle;
    __syncthreads();
    const wp::int16* const pairs = pattern.data + (size_t)turn * PAIRS * 2;
    const unsigned char* const centre = smooth + REACH * PITCH + REACH;
    for (int p = thread; p < PAIRS; p += threads) {
        const unsigned char one = centre[pairs[2 * p]], other = centre[pairs[2 * p + 1]];
        const unsigned word = __ballot_sync(~0u, one < other);
        if (thread % 8 == 0)
            descriptors.data[(size_t)k * (PAIRS / 8) + p / 8] =
                (wp::uint8)(word >> thread % 32 & 255);
    }
}
