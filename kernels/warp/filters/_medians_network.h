// needs PIXEL, LEAST, MOST
// Medians by networks of exchanges. PIXEL may hold several values; LEAST and MOST choose of each.
// The columns of the window are sorted first, because neighbouring windows share them.
struct Network {
    static CUDA_CALLABLE inline void swap(PIXEL& low, PIXEL& high) {
        const PIXEL least = LEAST(low, high);
        high = MOST(low, high);
        low = least;
    }

    // Sort a column.
    static CUDA_CALLABLE inline void sort(PIXEL (&v)[3]) {
        swap(v[0], v[1]);
        swap(v[1], v[2]);
        swap(v[0], v[1]);
    }

    static CUDA_CALLABLE inline void sort(PIXEL (&v)[5]) {
        swap(v[0], v[3]);
        swap(v[1], v[4]);
        swap(v[0], v[2]);
        swap(v[1], v[3]);
        swap(v[0], v[1]);
        swap(v[2], v[4]);
        swap(v[1], v[2]);
        swap(v[3], v[4]);
        swap(v[2], v[3]);
    }

    // Return the median of nine, row by row, whose columns are sorted: of the largest of the first
    // row, the median of the second, and the least of the third.
    static CUDA_CALLABLE inline PIXEL median(PIXEL (&v)[9]) {
        const PIXEL first = MOST(MOST(v[0], v[1]), v[2]);
        const PIXEL last = LEAST(LEAST(v[6], v[7]), v[8]);
        const PIXEL middle = MOST(LEAST(v[3], v[4]), LEAST(MOST(v[3], v[4]), v[5]));
        return MOST(LEAST(first, middle), LEAST(MOST(first, middle), last));
    }

    // Return the median of twenty-five, row by row, whose columns are sorted. The first part sorts
    // what is needed of each row; then thirteen values can be the median.
    static CUDA_CALLABLE inline PIXEL median(PIXEL (&v)[25]) {
        swap(v[0], v[3]);
        swap(v[1], v[4]);
        swap(v[0], v[2]);
        swap(v[1], v[3]);
        swap(v[2], v[4]);
        swap(v[3], v[4]);
        swap(v[2], v[3]);
        swap(v[5], v[8]);
        swap(v[6], v[9]);
        swap(v[6], v[8]);
        swap(v[5], v[6]);
        swap(v[7], v[9]);
        swap(v[6], v[7]);
        swap(v[8], v[9]);
        swap(v[7], v[8]);
        swap(v[10], v[13]);
        swap(v[11], v[14]);
        swap(v[10], v[12]);
        swap(v[11], v[13]);
        swap(v[10], v[11]);
        swap(v[12], v[14]);
        swap(v[11], v[12]);
        swap(v[13], v[14]);
        swap(v[12], v[13]);
        swap(v[15], v[18]);
        swap(v[16], v[19]);
        swap(v[15], v[17]);
        swap(v[16], v[18]);
        swap(v[15], v[16]);
        swap(v[17], v[19]);
        swap(v[16], v[17]);
        swap(v[17], v[18]);
        swap(v[20], v[23]);
        swap(v[21], v[24]);
        swap(v[20], v[22]);
        swap(v[21], v[23]);
        swap(v[20], v[21]);
        swap(v[22], v[24]);
        swap(v[21], v[22]);
        swap(v[20], v[13]);
        swap(v[7], v[11]);
        swap(v[20], v[12]);
        swap(v[3], v[15]);
        swap(v[4], v[16]);
        swap(v[8], v[17]);
        swap(v[16], v[9]);
        swap(v[20], v[4]);
        swap(v[11], v[15]);
        swap(v[12], v[16]);
        swap(v[8], v[21]);
        swap(v[4], v[12]);
        swap(v[15], v[8]);
        swap(v[4], v[15]);
        swap(v[12], v[8]);
        swap(v[12], v[15]);
        return v[15];
    }
};
