#pragma once
// Places beyond a border, mirrored at the last element, which is not repeated.
struct Mirror {
    // The place within n that place i is the mirror image of.
    static CUDA_CALLABLE int at(int i, int n) {
        if (i >= 0 && i < n) return i;  // most are: a remainder takes longer than all else
        const int period = n > 1 ? 2 * n - 2 : 1;
        i = (i < 0 ? -i : i) % period;
        return i < n ? i : period - i;
    }
};
