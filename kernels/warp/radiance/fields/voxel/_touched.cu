#pragma once

// The touched nodes among NODES nodes per thread of a block of BLOCK threads, listed by the block.
struct TouchedNodes {
    const unsigned short* found;  // offsets from `begin`
    int begin, count;

    TouchedNodes(const wp::uint8* touched, int all, int thread) {
        __shared__ unsigned short room[NODES * BLOCK];
        __shared__ int number;
        if (threadIdx.x == 0) number = 0;
        __syncthreads();
        const int first = NODES * thread;
        begin = first - NODES * threadIdx.x;
        auto find = [&](int node) { room[atomicAdd(&number, 1)] = node - begin; };
        if (first + NODES <= all) {
            const unsigned long long marks = ((const unsigned long long*)touched)[thread];
            if (marks)
                for (int k = 0; k < NODES; ++k)
                    if (marks >> 8 * k & 255u) find(first + k);
        } else
            for (int node = first; node < all; ++node)
                if (touched[node]) find(node);
        __syncthreads();
        found = room;
        count = number;
    }
};
